"""What of a file cannot be used: every place is counted, the first ones are kept one by one."""

from __future__ import annotations

from attlog.base.limits import MAX_DAMAGE
from attlog.formats.base import Damage


class Losses:
    """Damaged places while a reader finds them: ``places`` and ``bytes`` of all, :attr:`listed` the first in the file.

    A reader that reads forwards tells them in file order; what it says of a whole kind of record (a few per file)
    goes through :meth:`add_kind` and always stands in the list.
    """

    def __init__(self) -> None:
        self.places = 0
        self.bytes = 0
        self._one_by_one: list[Damage] = []
        self._kinds: list[Damage] = []

    def add(self, offset: int, length: int, lost: str, resumed: str) -> None:
        """One place with so many unusable bytes."""
        self.places += 1
        self.bytes += length
        if len(self._one_by_one) < MAX_DAMAGE:
            self._one_by_one.append(Damage(offset, length, lost, resumed))

    def add_kind(self, offset: int, length: int, lost: str, resumed: str, counted: bool = False) -> None:
        """All records of a kind at once, by the place of the first; ``counted``: their bytes are counted already."""
        self.places += 1
        self.bytes += 0 if counted else length
        if len(self._kinds) < MAX_DAMAGE:
            self._kinds.append(Damage(offset, length, lost, resumed))

    @property
    def listed(self) -> list[Damage]:
        """The places in file order, at most :data:`attlog.base.limits.MAX_DAMAGE`."""
        one_by_one = self._one_by_one[: MAX_DAMAGE - len(self._kinds)]
        return sorted([*one_by_one, *self._kinds], key=lambda d: d.offset)

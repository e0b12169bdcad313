"""What a ULog defines on the way: formats by name, and which id stands for which topic, instance and layout."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.base.limits import MAX_FORMATS, MAX_REDEFINED, MAX_RESUBSCRIBED
from attlog.formats.base import Remark
from attlog.formats.ulog.layout import Formats, TopicLayout


@dataclass(frozen=True, slots=True)
class Subscription:
    """What records of an id are."""

    name: str
    multi: int
    layout: TopicLayout


class Definitions:
    """The formats and subscriptions of one power-up, within the limits of what a log may ask for."""

    def __init__(self) -> None:
        self.by_id: dict[int, Subscription] = {}
        self.why_not: dict[int, tuple[str, str]] = {}
        self._formats = Formats()
        self._redefined = self._resubscribed = self._too_many = 0
        self._free_of_size: dict[int, list[tuple[str, TopicLayout]]] | None = None

    def declare(self, text: str) -> None:
        """Take in a format text; what is no text of a format is found out when it is used."""
        name = text.partition(":")[0]
        known = self._formats.texts.get(name)
        if known == text:
            return
        if known is None and len(self._formats.texts) >= MAX_FORMATS:
            self._too_many += 1
        elif not self._formats.is_used(name):
            self._formats.texts[name] = text
        elif self._redefined < MAX_REDEFINED:
            self._redefined += 1
            self._formats = Formats(self._formats.texts | {name: text})
        else:
            self._redefined += 1

    def subscription(self, identifier: int, name: str, multi: int) -> Subscription | None:
        """What a subscription says that the id means from now on; None if the definition cannot be used."""
        layout = self._formats.layout(name)
        before = self.by_id.get(identifier)
        if isinstance(layout, str):
            self.why_not.setdefault(identifier, (name, layout))
            return None
        now = Subscription(name, multi, layout)
        if before is None or before == now:
            return before or now
        self._resubscribed += 1
        return before if self._resubscribed > MAX_RESUBSCRIBED else now

    def without_subscription(self, size: int) -> list[tuple[str, TopicLayout]]:
        """Formats that no id stands for, whose records have so many bytes behind the id. Asked at the log's end."""
        if self._free_of_size is None:
            self._free_of_size = {}
            subscribed = {subscription.name for subscription in self.by_id.values()}
            for name in sorted(self._formats.texts.keys() - subscribed):
                layout = self._formats.layout(name)
                if isinstance(layout, TopicLayout):
                    for length in {layout.size, layout.full_size}:
                        self._free_of_size.setdefault(length, []).append((name, layout))
        return self._free_of_size.get(size, [])

    def remarks(self) -> list[Remark]:
        """What was left out because there is more of it than a log can sensibly define."""
        said = (
            (self._too_many, MAX_FORMATS, "formats", "the others are not read"),
            (self._redefined - MAX_REDEFINED, MAX_REDEFINED, "formats declared anew", "then they stay"),
            (self._resubscribed - MAX_RESUBSCRIBED, MAX_RESUBSCRIBED, "ids that change their topic", "then they stay"),
        )
        refused = dict(self.why_not.values())
        others = {1: "", 2: "; one other topic neither"}.get(len(refused), f"; {len(refused) - 1} other topics neither")
        unusable = [
            Remark("unreadable_message", f"{name} cannot be used: {why}{others}.", count=len(refused))
            for name, why in list(refused.items())[:1]
        ]
        return unusable + [
            Remark("log_limit", f"The log has {most + beyond} {what}; the first {most} count, {then}.", count=beyond)
            for beyond, most, what, then in said
            if beyond > 0
        ]

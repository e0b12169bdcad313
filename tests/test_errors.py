"""What a person reads about an error stays readable, however much is wrong."""

from __future__ import annotations

from attlog.errors import MAX_LETTERS, MAX_LINES, UsageError, message


def test_a_short_message_is_as_it_is() -> None:
    text = "\n".join(f"line {k}" for k in range(MAX_LINES))
    assert message(UsageError(text), "1") == f"attlog: {text}"


def test_thousands_of_lines_are_counted_and_a_line_of_megabytes_is_cut() -> None:
    lines = message(UsageError("\n".join(f"line {k}" for k in range(3000))), "1").split("\n")
    assert len(lines) == MAX_LINES + 1
    assert lines[-1] == f"and {3000 - MAX_LINES} more lines like these"
    assert len(message(UsageError("x" * 10**6), "1")) < MAX_LETTERS + 20

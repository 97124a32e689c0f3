"""What an FMU says through its logger, each message once with its count."""

import re
from collections import deque
from collections.abc import Mapping
from typing import Any

from attrs import frozen

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_KINDS = 64
_STATUS = ("info", "warning", "discarded", "error", "fatal error", "pending")


@frozen
class FmuMessage:
    """A message of an FMU: the component, how serious, the words when it came first, when [s] that was, how often it
    came; messages that differ in numbers only are counted as one.
    """

    component: str
    level: str
    text: str
    time: float
    count: int

    def __str__(self) -> str:
        often = f" ({self.count} times, first at t = {self.time:.9g} s)" if self.count > 1 else ""
        return f"{self.component} says: {self.text} [{self.level}]{often}"

    def to_dict(self) -> dict[str, object]:
        """The message in summary.json."""
        return {
            "component": self.component,
            "level": self.level,
            "text": self.text,
            "first_at": self.time,
            "count": self.count,
        }

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> "FmuMessage":
        """The message that `to_dict` gave."""
        return cls(entry["component"], entry["level"], entry["text"], entry["first_at"], entry["count"])


class MessageLog:
    """The messages of one instance since it was started; `recent` are the last few, for an error's words."""

    def __init__(self, component: str, everything: bool) -> None:
        self.component: str = component
        self.least: int = 0 if everything else 1
        self.recent: deque[str] = deque(maxlen=8)
        self.first: dict[str, tuple[str, str, float]] = {}
        self.counts: dict[str, int] = {}

    def clear(self) -> None:
        for store in (self.recent, self.first, self.counts):
            store.clear()

    def hear(self, status: int, text: str, time: float) -> None:
        """Take a message in; what is said after 64 different messages is counted as one more."""
        if status > 0:
            self.recent.append(text)
        if status < self.least:
            return
        level = _STATUS[status] if 0 <= status < len(_STATUS) else f"status {status}"
        kind = f"{level}: {_NUMBER.sub('#', text)}"
        if kind not in self.first and len(self.first) >= _KINDS:
            kind, text = "", f"further messages, the first of them: {text}"
        self.first.setdefault(kind, (level, text, time))
        self.counts[kind] = self.counts.get(kind, 0) + 1

    def counted(self) -> tuple[FmuMessage, ...]:
        """Every message once."""
        return tuple(
            FmuMessage(self.component, level, text, time, self.counts[kind])
            for kind, (level, text, time) in self.first.items()
        )

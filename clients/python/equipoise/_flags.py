"""Sets of flags that print as words."""

from __future__ import annotations

import enum


class Flags(enum.IntFlag):
    """A set of flags. Prints as the public names of the flags, `none` without any; Python 3.11 would print a number."""

    @property
    def names(self) -> list[str]:
        """Public names of the raised flags, lowest bit first."""
        return [name.lower() for name, flag in type(self).__members__.items() if self & flag]

    def __str__(self) -> str:
        return ", ".join(self.names) or "none"

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self}>"

    def __format__(self, spec: str) -> str:
        return format(int(self), spec) if spec else str(self)

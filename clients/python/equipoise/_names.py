"""Names of joints, segments and columns: spelling does not matter, an unknown name is refused with the nearest ones."""

from __future__ import annotations

import difflib
from typing import Iterable, Union

from ._messages import Joint

# So many known names are listed if none is near: all joints and segments.
KNOWN_MAX = 24


def _plain(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalnum())


def joint_name(joint: Joint) -> str:
    """MVN's name of a joint, as in recordings and JSON: `RightKnee`."""
    parts = joint.name.split("_")
    return "".join(part if any(map(str.isdigit, part)) else part.capitalize() for part in parts)


def find(kind: str, name: str, known: Iterable[str]) -> str:
    """The known name that `name` means: case, spaces and underscores do not count."""
    by_plain = {_plain(one): one for one in known}
    found = by_plain.get(_plain(name))
    if found is not None:
        return found
    near = [by_plain[one] for one in difflib.get_close_matches(_plain(name), by_plain, n=3)]
    remedy = f"nearest: {', '.join(near)}" if near else f"there are {', '.join([*by_plain.values()][:KNOWN_MAX])}"
    raise ValueError(f"no {kind} {name!r}; {remedy}")


def joint_of(joint: Union[Joint, str]) -> Joint:
    """A joint by its name, `RightKnee`, `RIGHT_KNEE` or `right knee`."""
    if isinstance(joint, str):
        by_name = {joint_name(one): one for one in Joint}
        return by_name[find("joint", joint, by_name)]
    return Joint(joint)

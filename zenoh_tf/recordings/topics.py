"""Which topics of a recording are read, how their frames are called, and which topic has a link.

Thread safety: none.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._core import TransformRows
from ..errors import InvalidArgumentException
from ..text import quoted
from .containers.container import Channel
from .decoders import READABLE, decoder
from .errors import RecordingError
from .poses import pose_decoder

#: The last parts of the two topics that ROS has for one tree: moving links, and static ones.
_MOVING, _STATIC = "tf", "tf_static"


class Topics:
    """The choice of a reader: topics, and the prefixes of their frames.

    Topics are compared without a slash at their begin.
    """

    def __init__(
        self, names: str | Collection[str] | None, prefixes: Mapping[str, str] | None
    ) -> None:
        """See `open_recording`.

        Raises:
            InvalidArgumentException: A name is empty or no text; `field` is "topics" or "prefixes".
        """
        asked = [names] if isinstance(names, str) else names
        self._asked = None if asked is None else {_bare(name, "topics"): name for name in asked}
        self._prefixes = {
            _bare(topic, "prefixes"): _bare(prefix, "prefixes")
            for topic, prefix in (prefixes or {}).items()
        }
        #: The topics with transforms that the recording has.
        self.transforms: set[str] = set()
        #: Those with poses, which are read only if they are asked for.
        self.poses: set[str] = set()
        self._bare: set[str] = set()  # all of these
        #: The sources of the channels that are read.
        self.sources: set[str] = set()

    def channel(self, topic: str, message_type: str, encoding: str) -> Channel | None:
        """The channel of a topic; None if it has no transforms or is not chosen."""
        bare = topic.lstrip("/")
        message_type = _ros_name(message_type)
        decode = decoder(message_type, encoding)
        if decode is not None:
            self.transforms.add(topic)
        elif (decode := pose_decoder(message_type, encoding, bare)) is not None:
            self.poses.add(topic)
        else:
            return None
        self._bare.add(bare)
        if bare not in self._asked if self._asked is not None else topic in self.poses:
            return None
        space, _, last = bare.rpartition("/")
        source = space + "/" if last in (_MOVING, _STATIC) else bare
        self.sources.add(source)
        return Channel(topic, decode, last == _STATIC, source, self._prefix(bare))

    def missing(self) -> list[str]:
        """The topics that were named and that were not found so far."""
        named = {**(self._asked or {}), **{bare: "/" + bare for bare in self._prefixes}}
        return sorted(name for bare, name in named.items() if bare not in self._bare)

    def nothing(self) -> str:
        """Why there is nothing to read."""
        found = self.transforms | self.poses
        if self._asked is not None and found:
            return f"none of the chosen topics has transforms; these have: {_listed(found)}"
        text = f"no message of type {READABLE}"
        if self.poses:
            first = min(self.poses)
            text += (
                f"; these topics have poses, which are read by request: {_listed(self.poses)}: "
                f"choose some by --topic {first} (in Python topics=[{first!r}])"
            )
        return text

    def cure(self, topics: tuple[str, str]) -> str:
        """What to do about a link that is on two topics."""
        first, second = topics
        space, _, last = first.rpartition("/")
        partner = f"{space}/{_STATIC if last == _MOVING else _MOVING}"
        both = last in (_MOVING, _STATIC) and partner in self.transforms
        chosen = sorted([first, partner]) if both else [first]
        # The prefix of a moving tree is its static one's as well.
        prefix = second.removesuffix("_static") if _last(second) == _STATIC else second
        return (
            f"choose one by {' '.join(f'--topic {each}' for each in chosen)}, or give the frames "
            f"of one a prefix by --prefix {prefix}=NAME (in Python topics={chosen!r} or "
            f"prefixes={{{prefix!r}: 'NAME'}})"
        )

    def _prefix(self, bare: str) -> str:
        """The prefix of a topic's frames. That of a moving tree is also its static one's."""
        found = self._prefixes.get(bare)
        if found is None and _last(bare) == _STATIC:
            found = self._prefixes.get(bare.removesuffix("_static"))
        return found or ""


class LinkTopics:
    """Finds links that two topics have; ``tf`` and ``tf_static`` of a namespace are one."""

    def __init__(self, path: object, topics: Topics) -> None:
        self._path = path
        self._topics = topics
        self._found: dict[str, Channel] = {}  # by child frame

    def check(self, rows: TransformRows, channels: Sequence[Channel], counts: list[int]) -> None:
        """Check the rows of messages.

        Args:
            rows: Their rows, one message after the other.
            channels: The channel of each message.
            counts: The rows of each.

        Raises:
            RecordingError: A link is on another topic as well.
        """
        kinds, numbers = _numbered(channels)
        key = rows.child.astype(np.int64)
        if len(kinds) > 1:
            key = key * len(kinds) + np.repeat(numbers, counts)
        names = rows.names
        for child, number in (divmod(each, len(kinds)) for each in np.unique(key).tolist()):
            channel = kinds[number]
            if not names[child]:
                continue  # no tree accepts it
            known = self._found.setdefault(names[child].lstrip("/"), channel)
            if known.source != channel.source:
                both = known.topic, channel.topic
                raise RecordingError(
                    f"{self._path}: frame {quoted(names[child])} is on two topics, "
                    f"{quoted(both[0])} and {quoted(both[1])}, which may be two bodies, so they "
                    f"are not mixed: {self._topics.cure(both)}"
                )


def prefixed(rows: TransformRows, channels: Sequence[Channel], counts: list[int]) -> TransformRows:
    """The rows of messages with the prefixes of their channels before the names of frames.

    A name that has the prefix stays as it is. Arguments: as of `LinkTopics.check`.
    """
    if not any(channel.prefix for channel in channels):
        return rows
    kinds, numbers = _numbered(channels)
    by_row = np.repeat(numbers, counts)
    size = len(rows.names)
    links = np.concatenate([rows.parent, rows.child]) + size * np.concatenate([by_row, by_row])
    used, places = np.unique(links, return_inverse=True)
    names: dict[str, int] = {}
    found = [
        names.setdefault(_renamed(kinds[each // size].prefix, rows.names[each % size]), len(names))
        for each in used.tolist()
    ]
    parent, child = np.split(np.array(found, np.uint32)[places.ravel()], 2)
    return TransformRows([*names], parent, child, rows.stamp, rows.pose)


def _renamed(prefix: str, name: str) -> str:
    bare = name.lstrip("/")
    return bare if not prefix or not bare or bare.startswith(f"{prefix}/") else f"{prefix}/{bare}"


def _numbered(channels: Sequence[Channel]) -> tuple[list[Channel], NDArray[np.int64]]:
    """Each channel once, and the number of each in these."""
    kinds: dict[int, int] = {}  # by identity: equal ones may differ in their decoders
    once: list[Channel] = []
    numbers = []
    for channel in channels:
        number = kinds.setdefault(id(channel), len(once))
        if number == len(once):
            once.append(channel)
        numbers.append(number)
    return once, np.array(numbers, np.int64)


def _last(topic: str) -> str:
    return topic.rpartition("/")[2]


def _ros_name(message_type: str) -> str:
    """The name of a type as ROS writes it. Recorders of DDS write that of its IDL, such as
    ``tf2_msgs::msg::dds_::TFMessage_``."""
    if "::" not in message_type:
        return message_type
    return message_type.replace("::dds_::", "::").replace("::", "/").removesuffix("_")


def _bare(name: object, field: str) -> str:
    bare = name.strip("/") if isinstance(name, str) else ""
    if not bare:
        raise InvalidArgumentException(
            f"{field} has {name!r}: a name must be a text that is not empty", field=field
        )
    return bare


def _listed(topics: Collection[str]) -> str:
    return ", ".join(map(quoted, sorted(topics)))

"""`Recording`: the transforms of a file or folder, whatever its container and encoding."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from os import PathLike
from pathlib import Path
from typing import Final, NamedTuple

from .._core import TransformRows
from ..formats.rows import Decoded
from ..text import quoted
from ..text.reasons import reason
from ..text.times import seconds
from .containers.container import Channel, Container, RawMessage
from .containers.decompress import ZSTD_MAGIC, decompress_message
from .containers.opening import open_all
from .errors import RecordingError
from .topics import LinkTopics, Topics, prefixed

#: Messages that are decoded together; their rows need about as much. Larger ones are not faster,
#: and progress is shown by block: 10 GB of images may have 10 MB of transforms.
_BLOCK_BYTES: Final = 1 << 18


class Message(NamedTuple):
    """One recorded message."""

    log_ns: int  # when it was recorded
    topic: str
    static: bool
    rows: TransformRows


class Block(NamedTuple):
    """Rows of successive messages, in order: only static ones, or only dynamic ones."""

    rows: TransformRows
    static: bool
    messages: int  # how many


class Recording:
    """The messages with transforms of one recording, in the order of its log.

    Links of topics called ``tf_static``, in any namespace, are static: they hold at all times. No
    other mark is common to all: ROS 1 has no durability, and bridges lose it.

    Thread safety: none.
    """

    def __init__(
        self,
        path: Path,
        containers: list[Container],
        topics: Topics,
        faults: list[str],
        *,
        mixed: bool,
    ) -> None:
        """Use `open_recording` instead."""
        self._path = path
        self._containers = containers
        self._chosen = topics
        self._faults = faults  # of files of the folder that cannot be opened
        self._mixed = mixed
        self._links = LinkTopics(path, topics)
        #: The topics that were read so far and had messages.
        self.topics: set[str] = set()
        #: Messages that could not be decoded so far, and why the first one could not.
        self.malformed = 0
        self.first_fault = ""
        #: Transforms that no tree accepts so far, such as NaN or a frame in itself. The reader of
        #: the messages counts them.
        self.skipped = 0
        self.first_skipped = ""  # what was wrong with the first of them
        #: The first and last stamp of the dynamic transforms so far that a tree accepts; None
        #: without one. The reader of the messages sets it.
        self.range_ns: tuple[int, int] | None = None
        #: When the last dynamic transforms of the blocks so far were recorded; None without any.
        self.last_log_ns: int | None = None

    @property
    def message_count(self) -> int | None:
        """How many messages there are on the topics that are read; None if only reading shows
        it."""
        counts = [container.message_count for container in self._containers]
        return None if None in counts else sum(count or 0 for count in counts)

    @property
    def is_cut_off(self) -> bool:
        """Whether a file lacks its end: its recorder was killed, or a copy is not complete."""
        return any(container.is_cut_off for container in self._containers)

    def messages(self) -> Iterator[Message]:
        """Yield the messages. May be called again, for another pass.

        Raises:
            RecordingError: The file is damaged, has no transforms, or has a link on two topics.
        """
        for raw in self._chosen_raw():
            found = self._decode([raw])
            if found is not None:
                yield Message(raw.log_ns, raw.channel.topic, raw.channel.static, found.rows)

    def blocks(self, until_ns: int | None = None) -> Iterator[Block]:
        """Yield the same as blocks of many messages, which is much faster.

        Args:
            until_ns: Leave out what was recorded later, in nanoseconds; None for nothing.

        Raises:
            RecordingError: The file is damaged, has no transforms by then, or has a link on two
                topics.
        """
        waiting: list[RawMessage] = []
        size = 0
        channel: Channel | None = None
        for raw in self._chosen_raw():
            if until_ns is not None and raw.log_ns > until_ns:
                if channel is None:
                    raise self._nothing_by(until_ns, raw.log_ns)
                break
            if not raw.channel.static:
                self.last_log_ns = raw.log_ns
            if channel is not None and (
                size >= _BLOCK_BYTES
                or raw.channel.static != channel.static
                or raw.channel.decode != channel.decode
            ):
                yield from self._block(waiting)
                waiting, size = [], 0
            channel = raw.channel
            waiting.append(raw)
            size += len(raw.data)
        if channel is not None:
            yield from self._block(waiting)

    def check(self) -> None:
        """Read up to the first message. Raises RecordingError if there is none."""
        next(self._chosen_raw(), None)

    def check_links(self) -> None:
        """Read all of it if links may be on two topics. Raises RecordingError if one is."""
        if len(self._chosen.sources) > 1 or self.message_count is None:
            for _ in self.blocks():
                pass

    def warnings(self) -> list[str]:
        """What a user should know of the messages that were read, in sentences."""
        found = list(self._faults)
        for container in self._containers:
            name = container.path.name
            if container.is_cut_off:
                found.append(f"{name} lacks its end; what is complete was read")
            if damage := container.damage.count:
                more = f"; {damage:,} such places in all" if damage > 1 else ""
                found.append(f"{name} is damaged {container.damage.first}{more}; the rest was read")
        if self.malformed:
            found.append(
                f"{self.malformed:,} messages skipped, which cannot be decoded ({self.first_fault})"
            )
        if self.skipped:
            found.append(
                f"{self.skipped:,} transforms skipped, which are not valid, such as: "
                f"{self.first_skipped}"
            )
        if missing := self._chosen.missing():
            found.append(
                f"no such topic with transforms or poses: {', '.join(map(quoted, missing))}"
            )
        return found

    def _block(self, messages: list[RawMessage]) -> Iterator[Block]:
        found = self._decode(messages)
        if found is not None:
            yield Block(found.rows, messages[0].channel.static, len(messages))

    def _decode(self, messages: Sequence[RawMessage]) -> Decoded | None:
        """The rows of messages of one kind, without those that are malformed; None if all are."""
        channel = messages[0].channel
        found = channel.decode([raw.data for raw in messages])
        if found.malformed:
            self._count_malformed(found.malformed, channel.topic, found.first_fault)
        if found.malformed == len(messages):
            return None
        channels = [raw.channel for raw in messages]
        rows = prefixed(found.rows, channels, found.counts)
        if not self._mixed:
            self._links.check(rows, channels, found.counts)
        return found._replace(rows=rows)

    def _count_malformed(self, count: int, topic: str, why: str) -> None:
        self.first_fault = self.first_fault or f"{topic}: {why}"
        self.malformed += count

    def _chosen_raw(self) -> Iterator[RawMessage]:
        """Yield the messages, and restart the counters."""
        self.topics.clear()
        self.malformed = self.skipped = 0
        self.first_fault = ""
        self.range_ns = self.last_log_ns = None
        for raw in self._raw():
            self.topics.add(raw.channel.topic)
            yield raw
        if not self.topics:
            raise RecordingError(f"{self._path}: {self._nothing()}")

    def _raw(self) -> Iterator[RawMessage]:
        for container in self._containers:
            messages = container.messages()
            while True:
                try:
                    raw = next(messages)
                except StopIteration:
                    break
                except Exception as error:  # libraries raise any on damaged files
                    raise RecordingError(f"{container.path}: {reason(error)}") from error
                if raw.data.startswith(ZSTD_MAGIC):
                    try:
                        raw = raw._replace(data=decompress_message(raw.data))
                    except Exception as error:  # the library raises any on damage
                        self._count_malformed(1, raw.channel.topic, reason(error))
                        continue
                yield raw

    def _nothing_by(self, until_ns: int, begin_ns: int) -> RecordingError:
        return RecordingError(
            f"{self._path}: nothing was recorded by {seconds(until_ns)} s: the log begins at "
            f"{seconds(begin_ns)} s"
        )

    def _nothing(self) -> str:
        if all(container.is_empty for container in self._containers):
            return "the recording is empty: it has no messages"
        return "; ".join([self._chosen.nothing(), *self.warnings()])


@contextmanager
def open_recording(
    path: str | PathLike[str],
    topics: str | Collection[str] | None = None,
    prefixes: Mapping[str, str] | None = None,
    *,
    mixed: bool = False,
) -> Iterator[Recording]:
    """Open a recording: an MCAP, db3 or bag file, or a folder of ``ros2 bag record``.

    Args:
        path: The file or folder.
        topics: Names of topics to read, or one name, with or without a slash at the begin; None for
            all that have transforms. Topics with one pose (TransformStamped, PoseStamped,
            PoseWithCovarianceStamped, Odometry) are read only if they are named.
        prefixes: By topic, what comes before the names of its frames, and a slash between them;
            that of a topic ``tf`` holds for ``tf_static`` of its namespace as well.
        mixed: Also read a link that is on two topics, instead of raising an error.

    Returns:
        A context manager of the `Recording`, which is closed at the end.

    Raises:
        RecordingError: It cannot be read, has no transforms, or a library is missing. A link that
            is on two topics raises it as soon as it is read.
        InvalidArgumentException: A name of a topic or a prefix is empty; `field` is "topics" or
            "prefixes".
    """
    path = Path(path)
    chosen = Topics(topics, prefixes)
    with ExitStack() as stack:
        containers, faults = open_all(path, chosen.channel, stack)
        recording = Recording(path, containers, chosen, faults, mixed=mixed)
        recording.check()
        yield recording

"""The server's log: text or JSON on standard error, safe whatever a record contains.

Records quote what clients have sent. The formatters escape and cut every line, so that no call of
the logger has to. A record is one line; in the text format, the lines of a traceback follow it,
indented, so that no message can pass for a record of its own. `log_handler` bounds the rate.
"""

from __future__ import annotations

import json
import logging
import sys
import threading
import time
import traceback
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Final, Literal

from zenoh_tf.text import cut, printable, quoted

from ..flag_table import flag
from .log_handler import DescriptorHandler

Format = Literal["text", "json"]

#: The flags of logs and metrics.
GROUP: Final = "logs and metrics (docs/reference/metrics.md)"

#: UTF-8 bytes of a line, and of a JSON record with a traceback.
MAX_LINE_BYTES: Final = 2048
MAX_JSON_BYTES: Final = 8192
_MAX_MESSAGE_CHARS: Final = 1500
_MAX_TRACEBACK_LINES: Final = 40
_MAX_TRACEBACK_CHARS: Final = 4000
#: So few, and with names so short, that all names fit into a line.
_MAX_FIELDS: Final = 8
_MAX_NAME_CHARS: Final = 32
_MAX_FIELD_CHARS: Final = 120
_INDENT: Final = "    | "

#: What every record has; other attributes are fields that a call has added with `extra`.
_STANDARD: Final = frozenset(
    {*vars(logging.makeLogRecord({})), "message", "asctime", "taskName", "suppressed"}
)

log = logging.getLogger("zenoh_tf.server")


@dataclass(frozen=True)
class LogSettings:
    """What the flags of the log say."""

    level: str = flag(
        "--log-level",
        "info",
        "debug, info, warning or error (default: %(default)s)",
        group=GROUP,
        choices=("debug", "info", "warning", "error"),
        metavar="LEVEL",
    )
    format: Format = flag(
        "--log-format",
        "text",
        "text, or json: an object a line (default: %(default)s)",
        group=GROUP,
        choices=("text", "json"),
        metavar="FORMAT",
    )


def setup(settings: LogSettings) -> None:
    """Log everything of this process to standard error: records, Python's warnings, and
    exceptions that nothing catches."""
    handler: logging.Handler = logging.NullHandler()
    if sys.stderr is not None:  # None: the server was started without a standard error
        handler = DescriptorHandler(sys.stderr.fileno())
    handler.setFormatter(JsonFormatter() if settings.format == "json" else TextFormatter())
    logging.basicConfig(level=settings.level.upper(), handlers=[handler], force=True)
    logging.captureWarnings(True)
    sys.excepthook = _log_uncaught
    threading.excepthook = _log_uncaught_in_thread
    sys.unraisablehook = _log_unraisable


class TextFormatter(logging.Formatter):
    """Time, level, logger and message in a line, then the traceback if there is one."""

    def format(self, record: logging.LogRecord) -> str:
        head = f"{_time(record)} {record.levelname:<7} {record.name}: "
        lines = [head + _message(record)]
        lines += (_INDENT + line for line in _traceback(record))
        return "\n".join(_cut_bytes(printable(line), MAX_LINE_BYTES) for line in lines)


class JsonFormatter(logging.Formatter):
    """One JSON object: time, level, logger, message, the call's own fields, and the traceback.

    Texts are escaped twice, so that they are still printable after a reader has parsed them.
    """

    def format(self, record: logging.LogRecord) -> str:
        fields: dict[str, Any] = {
            "time": _time(record),
            "level": record.levelname.lower(),
            "logger": printable(cut(record.name, _MAX_FIELD_CHARS)),
            "message": printable(_message(record)),
        }
        fields |= {name: value for name, value in _fields(record).items() if name not in fields}
        limit = MAX_LINE_BYTES
        if lines := _traceback(record):
            fields["traceback"] = "\n".join(map(printable, lines))
            limit = MAX_JSON_BYTES
        while len((line := _dumps(fields)).encode()) > limit:  # escapes have doubled a text
            longest = max(fields, key=lambda name: len(str(fields[name])))
            fields[longest] = str(fields[longest])[: len(str(fields[longest])) // 2] + "..."
        return line


def _dumps(fields: dict[str, Any]) -> str:
    return json.dumps(fields, ensure_ascii=False)  # all texts are printable: nothing else is raw


def _time(record: logging.LogRecord) -> str:
    """The time in UTC, ISO 8601, with milliseconds."""
    seconds = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
    return f"{seconds}.{int(record.msecs):03d}Z"


def _message(record: logging.LogRecord) -> str:
    try:
        text = record.getMessage()
    except Exception as error:  # a wrong call of the logger must not end a worker
        text = f"{record.msg} (cannot be formatted: {error})"
    text = cut(text, _MAX_MESSAGE_CHARS)
    suppressed = getattr(record, "suppressed", 0)  # the handler has counted them
    return f"{text} ({suppressed} more were suppressed)" if suppressed else text


def _fields(record: logging.LogRecord) -> dict[str, Any]:
    own = [(name, value) for name, value in vars(record).items() if name not in _STANDARD]
    return {printable(name)[:_MAX_NAME_CHARS]: _value(value) for name, value in own[:_MAX_FIELDS]}


def _value(value: object) -> object:
    if value is None or isinstance(value, (bool, int)):
        return value
    if isinstance(value, float):
        return value if value - value == 0 else str(value)  # JSON has no NaN and no infinity
    if isinstance(value, str):
        return printable(cut(value, _MAX_FIELD_CHARS))
    return quoted(value)


def _traceback(record: logging.LogRecord) -> list[str]:
    """The lines of the record's exception: the last ones, because those say the cause."""
    info = record.exc_info
    if not info or info[1] is None:
        return record.stack_info.splitlines()[-_MAX_TRACEBACK_LINES:] if record.stack_info else []
    lines: list[str] = []
    room = _MAX_TRACEBACK_CHARS
    for part in reversed(traceback.format_exception(info[1])):
        for line in reversed(cut(part.rstrip("\n"), _MAX_TRACEBACK_CHARS).split("\n")):
            short = cut(line, min(room, _MAX_MESSAGE_CHARS)) if room > 40 else ""
            if len(lines) == _MAX_TRACEBACK_LINES or not short:
                return [*reversed(lines)]
            lines.append(short)
            room -= len(short)
    return [*reversed(lines)]


def _cut_bytes(line: str, limit: int) -> str:
    data = line.encode()
    return line if len(data) <= limit else data[: limit - 3].decode(errors="ignore") + "..."


def _log_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    if isinstance(error, Exception):
        log.critical("uncaught exception", exc_info=(kind, error, trace))
    else:  # Ctrl-C during the start
        sys.__excepthook__(kind, error, trace)


def _log_uncaught_in_thread(args: threading.ExceptHookArgs) -> None:
    name = args.thread.name if args.thread is not None else "unknown"
    if args.exc_value is not None and not isinstance(args.exc_value, SystemExit):
        log.critical("uncaught exception in thread %s", name, exc_info=args.exc_value)


def _log_unraisable(args: sys.UnraisableHookArgs) -> None:
    what = args.err_msg or "exception ignored"
    log.error("%s in %s", what, quoted(args.object), exc_info=args.exc_value)

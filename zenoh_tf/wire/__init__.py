"""The wire protocol, version 1: msgpack maps with columns. No I/O; client and server share it.

`fields` converts bytes and checks types, `error_codec` has errors, `lookup` reads, `estimates` has
poses with errors, `commit` writes, `calls` batches, info and admin requests, `stream` what
mirrors follow, `samples` the samples in it, `interest` which part of it, and `floor` which state a
reply must be of at least.
docs/reference/protocol.md describes it for other languages.
"""

from .._core import Changes, Frames
from .calls import (
    batch_body,
    batch_reply,
    call_body,
    parse_batch,
    parse_batch_reply,
    parse_stats,
    parse_value,
    stats_value,
)
from .commit import (
    Commit,
    Write,
    commit_body,
    commit_parts,
    parse_commit,
    parse_commit_reply,
    parse_write,
    write_fields,
)
from .error_codec import (
    as_transform_exception,
    decode_error,
    encode_error,
    error_reply,
    raise_error,
)
from .estimates import (
    ESTIMATE_BYTES,
    Estimates,
    MotionLimits,
    estimates_body,
    estimates_value,
    motion_limits_fields,
    parse_estimates,
    parse_estimates_reply,
    parse_motion_limits,
)
from .fields import (
    F64,
    I64,
    MAX_MESSAGE_BYTES,
    MAX_REPLY_BYTES,
    VERSION,
    Message,
    column,
    flag,
    integer,
    mapping,
    name,
    number,
    pack,
    pack_in_steps,
    raw,
    text,
    texts,
    unpack,
)
from .floor import AGE_NS, FLOOR, floor_field, parse_age_s, take_floor, with_field
from .interest import Interest, parse_interest
from .lookup import (
    NO_STAMP,
    OP_AT,
    OP_COMMON,
    OP_COMMON_TIME,
    OP_FULL,
    OP_LATEST,
    OP_LATEST_XACT,
    AnswerRow,
    Lookup,
    LookupReply,
    Pose,
    lookup_body,
    lookup_reply,
    one_answer,
    one_read,
    pack_one_read,
    parse_lookup,
    parse_lookup_reply,
    parse_one_answer,
    parse_one_read,
    parse_read_set,
)
from .samples import Samples, samples_of_changes, samples_of_frames
from .stream import (
    NO_BOUNDS,
    SnapshotPiece,
    SnapshotPlan,
    SnapshotRequest,
    StreamMessage,
    missed_reply,
    missed_request,
    parse_missed_reply,
    parse_missed_request,
    parse_snapshot_piece,
    parse_snapshot_plan,
    parse_snapshot_request,
    parse_stream,
    snapshot_piece_reply,
    snapshot_plan_reply,
    snapshot_request,
    stream_body,
    unpack_stream,
)
from .tree_settings import TreeSettings

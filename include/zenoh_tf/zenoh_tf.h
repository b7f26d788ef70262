/* The transform tree for C: one that this process has, or that of a server on this host.
 *
 * A server's tree is read in the server's memory, as its Python clients read it: no message is sent
 * and nothing is copied. Its writes go to the server over Zenoh, see ztf_write_through(). If its
 * server ends, lookups fail with ZTF_SERVER_UNAVAILABLE until another one has the tree; they then
 * continue by themselves.
 *
 * Notation: a pose X_target_source maps a point's coordinates in source to coordinates in target.
 * Metres; unit quaternions x, y, z, w; stamps and durations in nanoseconds.
 *
 * Names are UTF-8 that ends with a zero byte, and do not begin with '/'.
 *
 * Errors: a function returns ZTF_OK, or the code of an error. `error` may be NULL. If it is not, it
 * must have its `size` set, and gets the error's facts and a message, which takes allocations.
 * Where a function fails, its other results are unspecified. Nothing is thrown.
 *
 * Size fields: the caller sets `size` of a structure to its sizeof. A later version of the library
 * may know more fields, which it then leaves alone. The structures without it never change.
 *
 * Thread safety: every function, from any thread at the same time, but for ztf_tree_close(), which
 * must be the last call for its tree. A forked child must not use a tree of its parent.
 *
 * Real time: a lookup without a time-out allocates nothing, takes no lock, and makes no system call
 * but reads of the clock, if `error` is NULL and its path has at most 30 links on either side.
 * Where the memory of a server's tree has grown, the first lookup asks for its size. If writers
 * change what is read, it is read again. Where they do so many times in a row, a lookup of a tree
 * of this process waits for them; one of a server's tree naps for half a millisecond at most, then
 * fails with ZTF_SERVER_BUSY. That error, ZTF_SERVER_UNAVAILABLE and ZTF_PROTOCOL allocate.
 */
#ifndef ZENOH_TF_H
#define ZENOH_TF_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define ZTF_API __attribute__((visibility("default")))
#else
#define ZTF_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* The codes of zenoh_tf's Python exceptions, and from 64 on others. */
typedef enum ztf_code {
  ZTF_OK = 0,
  ZTF_FAILED = 1,              /* an error of the library or the system; see the message */
  ZTF_LOOKUP = 2,              /* a frame does not exist, or the path is too long or a loop */
  ZTF_CONNECTIVITY = 3,        /* no path connects the frames */
  ZTF_INVALID_ARGUMENT = 4,    /* `field` names the argument */
  ZTF_TIMEOUT = 5,             /* a write was not done in its time, and never will be */
  ZTF_EXTRAPOLATION = 6,       /* a link has no data for the time: one of the next three */
  ZTF_NO_DATA = 7,             /* it has a single sample, at another time */
  ZTF_BACKWARD = 8,            /* the time is older than its oldest sample */
  ZTF_FORWARD = 9,             /* the time is newer than its newest sample */
  ZTF_CONFLICT = 10,           /* what a transaction has read was changed before its commit */
  ZTF_LIMIT = 11,              /* a limit is reached, or no memory is left */
  ZTF_SERVER_UNAVAILABLE = 13, /* no server has the tree, or it has stopped */
  ZTF_OUTCOME_UNKNOWN = 14,    /* no reply in time: the write was done, or never will be */
  ZTF_SERVER_RESTARTED = 15,   /* the write was not done: another server has the tree */
  ZTF_PROTOCOL = 16,           /* the server has another version, or its memory is corrupt */
  ZTF_SERVER_BUSY = 17,        /* writers changed what was read again and again */
  ZTF_ACCESS_DENIED = 18,      /* the server's socket is not for this user, or another user's */
  ZTF_NOT_DURABLE = 19,        /* the write was done, but is not on the server's disk yet */
  ZTF_READ_ONLY = 20,          /* a write to a replica, or without ztf_write_through() */
  ZTF_GAP = 22,                /* samples are farther apart than max_gap_ns */
  ZTF_SERVER_STARTING = 23,    /* ZTF_LOOKUP, but the server has just started: ask again */
  ZTF_STALE_FRAME = 64,        /* a ztf_frame of another tree, or whose id was given away */
  ZTF_BUFFER_TOO_SMALL = 65    /* `needed` says how many bytes the buffer must have */
} ztf_code;

/* As a stamp of a lookup: the latest time that all links have. As a fact: it does not apply. */
#define ZTF_NO_STAMP INT64_MIN
/* As ztf_lookup_options.max_gap_ns: what is much longer than the link's period. */
#define ZTF_NO_GAPS (-2)

typedef struct ztf_pose {
  double x, y, z;
  double qx, qy, qz, qw;
} ztf_pose;

/* The pose of child in parent. A rotation is normalised if its length is within 1e-2 of 1. */
typedef struct ztf_transform {
  const char* parent;
  const char* child;
  int64_t stamp_ns;
  ztf_pose pose;
} ztf_transform;

/* What a lookup has found. */
typedef struct ztf_answer {
  uint32_t size;           /* sizeof(ztf_answer) */
  ztf_pose pose;           /* X_target_source */
  int64_t stamp_ns;        /* of the pose; of ztf_latest(): the oldest stamp used; 0: static */
  int64_t newest_stamp_ns; /* of ztf_latest() and the like only: the newest stamp used */
  int64_t gap_ns;          /* the longest gap between samples that was interpolated over; 0: none */
} ztf_answer;

/* Why a call failed. Facts that do not apply are empty, ZTF_NO_STAMP or -1. Longer texts are cut.
 */
typedef struct ztf_error {
  uint32_t size;                                      /* sizeof(ztf_error) */
  int32_t code;                                       /* ztf_code */
  int64_t stamp_ns, oldest_stamp_ns, newest_stamp_ns; /* asked for; what the link can serve */
  int64_t gap_ns, limit, value;                       /* of ZTF_GAP, limit is in ns */
  double retry_after_s;
  char message[1024], field[64];
  char target_frame[256], source_frame[256]; /* of the lookup */
  char frame[256], parent_frame[256];        /* the offending frame, or link */
  char target_root[256], source_root[256];   /* ZTF_CONNECTIVITY: where the paths end */
} ztf_error;

typedef struct ztf_tree ztf_tree;

/* --- trees */

/* ZTF_OPTIONS_INIT has the defaults. */
typedef struct ztf_options {
  uint32_t size;                  /* sizeof(ztf_options) */
  uint32_t max_frames;            /* 2 to 2^30 */
  uint32_t max_samples_per_frame; /* 2 to 2^30 */
  uint32_t max_depth;             /* links between a frame and its root; 0: no limit */
  int64_t cache_time_ns;          /* samples older than the frame's newest by more are dropped */
  uint64_t max_memory_bytes;      /* of all samples; 0: no limit, else at least 65536 */
} ztf_options;
#define ZTF_OPTIONS_INIT {sizeof(ztf_options), 1u << 20, 1u << 16, 1000u, INT64_C(10000000000), 0u}

/* Returns the library's version, such as "0.1.0". */
ZTF_API const char* ztf_version(void);
/* Returns the name of a code, such as "ZTF_LOOKUP"; "unknown" for other numbers. */
ZTF_API const char* ztf_code_name(int32_t code);

/* Makes a tree in this process. `options` may be NULL. Allocates.
 * ZTF_INVALID_ARGUMENT, ZTF_LIMIT. */
ZTF_API ztf_code ztf_tree_create(const ztf_options* options, ztf_tree** tree, ztf_error* error);

/* Maps the tree of that name of a server on this host; a server's default name is "main". Waits up
 * to timeout_ns until there is a server. A thread of the library then follows the server: it maps
 * the tree again whenever another server has it.
 * folder: the server's --share-dir; NULL: zenoh-tf in $XDG_RUNTIME_DIR, then /run/zenoh-tf. A
 * folder must have one server of each tree's name; with more, the call fails, as a later one could
 * be another robot's. ZTF_SERVER_UNAVAILABLE, ZTF_ACCESS_DENIED, ZTF_PROTOCOL,
 * ZTF_INVALID_ARGUMENT, ZTF_LIMIT. */
ZTF_API ztf_code ztf_tree_open(const char* name, const char* folder, int64_t timeout_ns,
                               ztf_tree** tree, ztf_error* error);

/* Ends a tree, and waits for its thread. NULL is allowed. */
ZTF_API void ztf_tree_close(ztf_tree* tree);

typedef struct ztf_server {
  uint32_t size;         /* sizeof(ztf_server) */
  uint32_t mapped;       /* how often a server's memory was mapped; 1 after ztf_tree_open() */
  int64_t lease_left_ns; /* positive: lookups are answered */
  char instance[64];     /* of the server that was mapped last */
} ztf_server;
/* Says which server a tree is read from. ZTF_INVALID_ARGUMENT for a tree of this process. */
ZTF_API ztf_code ztf_server_state(const ztf_tree* tree, ztf_server* server, ztf_error* error);

/* --- writes
 *
 * They allocate, and take locks for a moment. Those of a server's tree wait for the server's reply,
 * and are in its memory then. They may also return ZTF_READ_ONLY, ZTF_TIMEOUT, ZTF_OUTCOME_UNKNOWN,
 * ZTF_SERVER_RESTARTED, ZTF_NOT_DURABLE, ZTF_SERVER_UNAVAILABLE, ZTF_ACCESS_DENIED, ZTF_PROTOCOL.
 */

enum { ZTF_STATIC = 1 /* flag: the link never changes with time */ };

/* Stores a transform. Sets *stored, unless it is NULL, to 0 if it is too old to be stored, which is
 * no error. A name may begin with one '/', which is removed. authority: who says so; may be NULL.
 * ZTF_INVALID_ARGUMENT (also a cycle), ZTF_LIMIT. */
ZTF_API ztf_code ztf_set(ztf_tree* tree, const ztf_transform* transform, const char* authority,
                         int32_t flags, int32_t* stored, ztf_error* error);
/* Stores all transforms at one instant, or none. Errors as ztf_set(), and a transform that is too
 * old is one. */
ZTF_API ztf_code ztf_set_xact(ztf_tree* tree, const ztf_transform* transforms, size_t count,
                              const char* authority, int32_t flags, ztf_error* error);
/* Drops all samples, and static links too unless keep_static. ZTF_LIMIT. */
ZTF_API ztf_code ztf_clear(ztf_tree* tree, int32_t keep_static, ztf_error* error);
/* Removes a frame, and with subtree all below it. ZTF_LOOKUP; ZTF_INVALID_ARGUMENT: it has children
 * and subtree is 0. */
ZTF_API ztf_code ztf_remove_frame(ztf_tree* tree, const char* frame, int32_t subtree,
                                  ztf_error* error);

typedef enum ztf_op {
  ZTF_AT = 0,            /* ztf_lookup() at a time */
  ZTF_LATEST_COMMON = 1, /* ztf_lookup() at the latest common time */
  ZTF_LATEST = 2,        /* ztf_latest() */
  ZTF_LATEST_XACT = 3    /* ztf_latest_xact() */
} ztf_op;

/* --- transactions
 *
 * Lookups, then writes that are stored only if all that was looked up still holds: as if the whole
 * had happened at one instant. For one thread at a time. */

typedef struct ztf_transaction ztf_transaction;

/* Begins a transaction, which must end before its tree. ZTF_LIMIT. */
ZTF_API ztf_code ztf_transaction_begin(ztf_tree* tree, ztf_transaction** transaction,
                                       ztf_error* error);
/* A lookup. All lookups of a transaction are at one instant: ZTF_CONFLICT if something that was
 * looked up before has changed, or another server has the tree. If it fails, the transaction rests
 * on that, too: on a frame that does not exist. ZTF_LATEST is as ZTF_LATEST_XACT. Errors as those
 * of lookups. */
ZTF_API ztf_code ztf_transaction_lookup(ztf_transaction* transaction, ztf_op op, const char* target,
                                        const char* source, int64_t stamp_ns, ztf_answer* answer,
                                        ztf_error* error);
/* Adds a transform to what the commit will store. Its values are checked then. */
ZTF_API ztf_code ztf_transaction_set(ztf_transaction* transaction, const ztf_transform* transform,
                                     ztf_error* error);
/* Stores all, or nothing: with ZTF_CONFLICT, something that was looked up has changed, and the
 * caller does the transaction again. It is empty afterwards in any case. Errors as ztf_set_xact().
 * Without transforms it succeeds, as it changes nothing. */
ZTF_API ztf_code ztf_transaction_commit(ztf_transaction* transaction, const char* authority,
                                        int32_t flags, ztf_error* error);
/* Ends a transaction without storing anything. NULL is allowed. */
ZTF_API void ztf_transaction_end(ztf_transaction* transaction);

/* --- writes to a server's tree
 *
 * They are queries over Zenoh (docs/reference/protocol.md). This library does not link to Zenoh:
 * the caller has a session, and gives a function that sends a query. zenoh_tf/zenoh_query.h has
 * one for zenoh-c and for zenoh-pico. */

typedef struct ztf_reply ztf_reply;
/* Keeps a copy of a reply's payload. */
ZTF_API void ztf_reply_set(ztf_reply* reply, const void* bytes, size_t size);
/* Sends a query with a payload, and waits up to timeout_ns for its first reply or error reply,
 * whose payload it gives to ztf_reply_set(). It calls that not at all if none has come. It is
 * called from the threads that write, several at a time, and must not throw. */
typedef void (*ztf_query_fn)(void* context, const char* key, const void* payload, size_t size,
                             int64_t timeout_ns, ztf_reply* reply);
/* Lets a server's tree be written to by query(context, ...), and gives each write a time-out, of at
 * most 600 s. At most once for a tree, before it is written to. ZTF_INVALID_ARGUMENT. */
ZTF_API ztf_code ztf_write_through(ztf_tree* tree, ztf_query_fn query, void* context,
                                   int64_t timeout_ns, ztf_error* error);

/* --- lookups, each at one instant of the tree
 *
 * All may return ZTF_LOOKUP, ZTF_CONNECTIVITY, ZTF_INVALID_ARGUMENT, and those of a server's tree
 * ZTF_SERVER_UNAVAILABLE, ZTF_SERVER_BUSY, ZTF_SERVER_STARTING, ZTF_PROTOCOL. Those at a time, and
 * those at the latest common one, may return the four errors of extrapolation, and ZTF_GAP.
 * `answer` may be NULL. */

/* ZTF_LOOKUP_INIT has the defaults. */
typedef struct ztf_lookup_options {
  uint32_t size;      /* sizeof(ztf_lookup_options) */
  int64_t timeout_ns; /* waits so long for an answer. Commits wake lookups of a tree of this
                         process; those of a server's tree ask again every millisecond. */
  int64_t max_gap_ns; /* no interpolation over more; -1: no limit; or ZTF_NO_GAPS */
} ztf_lookup_options;
#define ZTF_LOOKUP_INIT {sizeof(ztf_lookup_options), 0, -1}

/* Looks up X_target_source at a time, or with ZTF_NO_STAMP at the latest common time. `options`
 * may be NULL. */
ZTF_API ztf_code ztf_lookup(const ztf_tree* tree, const char* target, const char* source,
                            int64_t stamp_ns, const ztf_lookup_options* options, ztf_answer* answer,
                            ztf_error* error);
/* The same between two times: source at source_stamp_ns, through a frame `fixed` that does not move
 * between, to target at target_stamp_ns. */
ZTF_API ztf_code ztf_lookup_full(const ztf_tree* tree, const char* target, int64_t target_stamp_ns,
                                 const char* source, int64_t source_stamp_ns, const char* fixed,
                                 const ztf_lookup_options* options, ztf_answer* answer,
                                 ztf_error* error);
/* Returns 1 if ztf_lookup() would succeed, else 0. */
ZTF_API int32_t ztf_can(const ztf_tree* tree, const char* target, const char* source,
                        int64_t stamp_ns, const ztf_lookup_options* options);
/* Composes the newest sample of every link. Their stamps may differ, and each link may be read at
 * an instant of its own. */
ZTF_API ztf_code ztf_latest(const ztf_tree* tree, const char* target, const char* source,
                            ztf_answer* answer, ztf_error* error);
/* The same, with all links read at one instant. */
ZTF_API ztf_code ztf_latest_xact(const ztf_tree* tree, const char* target, const char* source,
                                 ztf_answer* answer, ztf_error* error);
/* Sets *stamp_ns to the latest time that all links between two frames have; ZTF_NO_STAMP if all are
 * static. */
ZTF_API ztf_code ztf_common_time(const ztf_tree* tree, const char* target, const char* source,
                                 int64_t* stamp_ns, ztf_error* error);

/* --- lookups without names
 *
 * A ztf_frame is a name that was found once. It stays valid for as long as the tree has the frame,
 * and in a server's tree until another server has it; then lookups return ZTF_STALE_FRAME, and the
 * caller finds the name again. */

typedef struct ztf_frame {
  uint64_t tree;
  uint32_t id, generation;
} ztf_frame;

/* Finds a frame. ZTF_LOOKUP if there is none of that name. */
ZTF_API ztf_code ztf_resolve(const ztf_tree* tree, const char* name, ztf_frame* frame,
                             ztf_error* error);
/* One lookup. stamp_ns is for ZTF_AT. */
ZTF_API ztf_code ztf_lookup_ref(const ztf_tree* tree, ztf_op op, const ztf_frame* target,
                                const ztf_frame* source, int64_t stamp_ns, ztf_answer* answer,
                                ztf_error* error);
/* One pair of frames at many times, such as those of a point cloud, each as a lookup of its own:
 * sets poses[i], and codes[i] to its ztf_code. Returns ZTF_OK also if some fail. Allocates nothing.
 */
ZTF_API ztf_code ztf_lookup_times(const ztf_tree* tree, const ztf_frame* target,
                                  const ztf_frame* source, const int64_t* stamps_ns, size_t count,
                                  ztf_pose* poses, int32_t* codes, ztf_error* error);
/* Many pairs of frames at one instant of the tree, such as two poses that a controller compares:
 * sets poses[i] and stamps_ns[i]. ZTF_AT is at stamp_ns, of all pairs. Returns the first failure.
 * Allocates nothing for at most 16 pairs whose paths have 64 links together. */
ZTF_API ztf_code ztf_lookup_xact(const ztf_tree* tree, ztf_op op, const ztf_frame* targets,
                                 const ztf_frame* sources, size_t count, int64_t stamp_ns,
                                 ztf_pose* poses, int64_t* stamps_ns, ztf_error* error);

/* Stores poses of child in parent, as ztf_set() does, all at one instant; in a tree of this process
 * in three quarters of its time. Sets *stored, unless it is NULL, to how many were not too old.
 * Never gives the child another parent: ZTF_INVALID_ARGUMENT. ZTF_STALE_FRAME if a frame was
 * removed. Of a server's tree both are checked before the write is sent. Other errors as those of
 * ztf_set(). */
ZTF_API ztf_code ztf_append(ztf_tree* tree, const ztf_frame* parent, const ztf_frame* child,
                            const int64_t* stamps_ns, const ztf_pose* poses, size_t count,
                            const char* authority, size_t* stored, ztf_error* error);

/* --- frames; these functions allocate
 *
 * Names are written to the caller's buffer, each with its zero byte at the end. *needed is set to
 * the bytes of all of them, also with ZTF_BUFFER_TOO_SMALL; the buffer may be NULL with size 0. */

/* The names of all frames. */
ZTF_API ztf_code ztf_frames(const ztf_tree* tree, char* buffer, size_t size, size_t* needed,
                            ztf_error* error);
/* The parent of a frame at a time, or with ZTF_NO_STAMP the newest one; no name for a root.
 * ZTF_LOOKUP. */
ZTF_API ztf_code ztf_parent(const ztf_tree* tree, const char* frame, int64_t stamp_ns, char* buffer,
                            size_t size, size_t* needed, ztf_error* error);
/* The frames from target to source over their common ancestor, at a time or by the newest links.
 * The errors of lookups. */
ZTF_API ztf_code ztf_chain(const ztf_tree* tree, const char* target, const char* source,
                           int64_t stamp_ns, char* buffer, size_t size, size_t* needed,
                           ztf_error* error);

typedef struct ztf_frame_info {
  uint32_t size;    /* sizeof(ztf_frame_info) */
  int32_t flags;    /* ZTF_STATIC */
  uint32_t samples; /* 0: a root */
  int64_t oldest_stamp_ns, newest_stamp_ns;
  char parent[256];    /* of the newest sample; empty: a root */
  char authority[256]; /* who wrote it last; may be empty */
} ztf_frame_info;
/* What is known of a frame. ZTF_LOOKUP. */
ZTF_API ztf_code ztf_info(const ztf_tree* tree, const char* frame, ztf_frame_info* info,
                          ztf_error* error);

#ifdef __cplusplus
}
#endif

#endif

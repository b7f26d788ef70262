// The functions of include/zenoh_tf/zenoh_tf.h but for writes: the core's, with values in the
// caller's memory, codes instead of exceptions, and a server's tree in the place of one of this
// process.
#include "zenoh_tf/zenoh_tf.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <string>
#include <thread>
#include <vector>

#include "base/small_vector.hpp"
#include "by_name/errors.hpp"
#include "by_name/lookup.hpp"
#include "c_api/calls.hpp"
#include "commits/validation.hpp"
#include "reads/sample_block.hpp"
#include "system/host.hpp"

namespace ztf::c_api {

namespace {

static_assert(sizeof(Pose) == sizeof(ztf_pose) && offsetof(ztf_pose, qw) == offsetof(Pose, qw));
static_assert(ZTF_NO_STAMP == kNoStamp && ZTF_NO_GAPS == kNoGaps);
static_assert(ZTF_AT == int(Op::at) && ZTF_LATEST_XACT == int(Op::latest_xact));
static_assert(ZTF_SERVER_STARTING == int(Code::starting) && ZTF_GAP == int(Code::gap) &&
              ZTF_STALE_FRAME == int(Code::stale_frame));

constexpr std::chrono::milliseconds kAskAgain{1};

// --- trees

void check_range(const char* field, std::uint64_t value, std::uint64_t least, std::uint64_t most) {
  if (value >= least && value <= most) return;
  reject(Code::invalid_argument,
         std::string(field) + " must be from " + std::to_string(least) + " to " +
             std::to_string(most) + ", not " + std::to_string(value),
         field);
}

Options options_of(const ztf_options* given) {
  const ztf_options o = read_sized(given, ztf_options ZTF_OPTIONS_INIT);
  constexpr std::uint64_t kMost = 1u << 30;
  check_range("max_frames", o.max_frames, 2, kMost);
  check_range("max_samples_per_frame", o.max_samples_per_frame, 2, kMost);
  check_range("max_depth", o.max_depth, 0, kMost);
  check_range("cache_time_ns", static_cast<std::uint64_t>(o.cache_time_ns), 1,
              1'000'000'000'000'000'000);
  if (o.max_memory_bytes != 0)
    check_range("max_memory_bytes", o.max_memory_bytes, 1 << 16, std::uint64_t{1} << 62);
  return {.cache_ns = static_cast<std::uint64_t>(o.cache_time_ns),
          .max_frames = o.max_frames,
          .max_samples_per_frame = o.max_samples_per_frame,
          .max_depth = o.max_depth,
          .max_memory_bytes = o.max_memory_bytes};
}

// --- lookups by names

// The result of a lookup: its answer, or its failure.
template <class AnyTree>
Code conclude(const AnyTree& tree, const NamedQuery& query, const Answer& answer,
              const LookupNote& note, ztf_answer* out, ztf_error* error) {
  if (answer.failure.code == Code::ok) [[likely]] {
    set_answer(answer, out);
    return Code::ok;
  }
  if (error) throw lookup_error(tree, answer.failure, query, note);
  return shown_code(answer.failure, !tree.startup().is_over());
}

NamedQuery query_of(Op op, const char* target, const char* source) {
  NamedQuery query;
  query.op = op;
  query.target_name = name_of(target, "target");
  query.source_name = name_of(source, "source");
  return query;
}

using Clock = BlockingWaiter::Clock;

Clock::time_point deadline_after(std::int64_t timeout_ns) {
  constexpr std::int64_t kMost = 1'000'000'000'000'000'000;
  if (timeout_ns < 0) reject(Code::invalid_argument, "timeout_ns is negative", "timeout_ns");
  return Clock::now() + std::chrono::nanoseconds(std::min(timeout_ns, kMost));
}

// True if there is an answer, or none can come.
bool wait(const Tree& tree, NamedQuery& query, Answer& answer, Clock::time_point deadline) {
  BlockingWaiter waiter(tree.state(), query, query.target_name, query.source_name,
                        query.fixed_name);
  if (!waiter.wait(deadline)) return false;
  answer = waiter.answer();
  return true;
}

// True if a lookup of a server's tree that ended with this code may succeed later.
bool may_wait_for(ztf_code code) noexcept {
  return code != ZTF_OK && code != ZTF_INVALID_ARGUMENT && code != ZTF_GAP && code != ZTF_LIMIT;
}

ztf_code look_up(const ztf_tree* tree, NamedQuery query, const LookupNote& note, ztf_answer* out,
                 ztf_error* error) noexcept {
  return guarded(tree, error, [&] {
    return read(tree, [&](const auto& of, std::uint64_t) {
      Answer answer;
      lookup(of, query, answer);
      return conclude(of, query, answer, note, out, error);
    });
  });
}

ztf_code look_up_waiting(const ztf_tree* tree, NamedQuery query, std::int64_t timeout_ns,
                         ztf_answer* out, ztf_error* error) {
  const Clock::time_point deadline = deadline_after(timeout_ns);
  const LookupNote late{.waited = waited_for(static_cast<double>(timeout_ns) * 1e-9),
                        .may_wait = true};
  if (tree->own) {
    Answer answer;
    if (wait(*tree->own, query, answer, deadline))
      return code_of(conclude(*tree->own, query, answer, {.may_wait = true}, out, error));
    return look_up(tree, query, late, out, error);
  }
  while (Clock::now() < deadline) {
    const ztf_code code = look_up(tree, query, {}, out, nullptr);
    if (!may_wait_for(code)) return code == ZTF_OK ? code : look_up(tree, query, {}, out, error);
    std::this_thread::sleep_until(std::min(deadline, Clock::now() + kAskAgain));
  }
  return look_up(tree, query, late, out, error);
}

ztf_code run(const ztf_tree* tree, NamedQuery& query, const ztf_lookup_options* given,
             ztf_answer* out, ztf_error* error) {
  if (!given) return look_up(tree, query, {.may_wait = true}, out, error);
  const ztf_lookup_options options = read_sized(given, ztf_lookup_options ZTF_LOOKUP_INIT);
  if (options.max_gap_ns < kNoGaps)
    reject(Code::invalid_argument, "max_gap_ns is negative", "max_gap_ns");
  query.max_gap = options.max_gap_ns;
  if (options.timeout_ns == 0) return look_up(tree, query, {.may_wait = true}, out, error);
  return look_up_waiting(tree, query, options.timeout_ns, out, error);
}

ztf_code look_up_op(Op op, const ztf_tree* tree, const char* target, const char* source,
                    ztf_answer* out, ztf_error* error) noexcept {
  return guarded(tree, error,
                 [&] { return Code(look_up(tree, query_of(op, target, source), {}, out, error)); });
}

// --- lookups by references

// True if the ids have belonged to the names since they were found.
template <class AnyTree>
bool is_current(const AnyTree& tree, std::uint64_t number, const ztf_frame& frame) noexcept {
  return frame.tree == number && tree.is_current(ref_of(frame, number));
}

Code stale(ztf_error* error) {
  if (error) reject_stale();
  return Code::stale_frame;
}

// The id of a frame as a lookup by its name would find it: 0 if the frame was removed.
template <class AnyTree>
FrameId found_id(const AnyTree& tree, const ztf_frame& frame) noexcept {
  return tree.removed(frame.id) ? 0 : frame.id;
}

template <class AnyTree>
Query query_of(const AnyTree& tree, Op op, const ztf_frame& target, const ztf_frame& source,
               Stamp stamp) noexcept {
  return {op, found_id(tree, target), found_id(tree, source), stamp};
}

// The error of a lookup by references. Throws, if there is an error to fill.
template <class AnyTree>
Code fail_ref(const AnyTree& tree, Op op, const ztf_frame& target, const ztf_frame& source,
              const Failure& failure, ztf_error* error) {
  if (!error) return shown_code(failure, !tree.startup().is_over());
  throw lookup_error(tree, failure, tree.name(target.id), tree.name(source.id), {},
                     op == Op::latest_common);
}

// --- names in the caller's buffer

Code write_names(const std::vector<std::string>& names, char* buffer, std::size_t size,
                 std::size_t* needed) {
  std::size_t bytes = 0;
  for (const std::string& name : names) bytes += name.size() + 1;
  if (needed) *needed = bytes;
  if (bytes > size) reject(kTooSmall, "the names take " + std::to_string(bytes) + " bytes", "size");
  for (const std::string& name : names) buffer = std::copy_n(name.c_str(), name.size() + 1, buffer);
  return Code::ok;
}

template <class AnyTree>
FrameId known(const AnyTree& tree, std::string_view name) {
  const FrameId id = tree.find(name);
  if (id == 0) throw unknown_frame(tree, name);
  return id;
}

}  // namespace

}  // namespace ztf::c_api

using namespace ztf;
using namespace ztf::c_api;

const char* ztf_version(void) { return ZTF_VERSION; }

const char* ztf_code_name(int32_t code) {
  static constexpr std::pair<ztf_code, const char*> kNames[] = {
      {ZTF_OK, "ZTF_OK"},
      {ZTF_FAILED, "ZTF_FAILED"},
      {ZTF_LOOKUP, "ZTF_LOOKUP"},
      {ZTF_CONNECTIVITY, "ZTF_CONNECTIVITY"},
      {ZTF_INVALID_ARGUMENT, "ZTF_INVALID_ARGUMENT"},
      {ZTF_TIMEOUT, "ZTF_TIMEOUT"},
      {ZTF_EXTRAPOLATION, "ZTF_EXTRAPOLATION"},
      {ZTF_NO_DATA, "ZTF_NO_DATA"},
      {ZTF_BACKWARD, "ZTF_BACKWARD"},
      {ZTF_FORWARD, "ZTF_FORWARD"},
      {ZTF_CONFLICT, "ZTF_CONFLICT"},
      {ZTF_LIMIT, "ZTF_LIMIT"},
      {ZTF_SERVER_UNAVAILABLE, "ZTF_SERVER_UNAVAILABLE"},
      {ZTF_OUTCOME_UNKNOWN, "ZTF_OUTCOME_UNKNOWN"},
      {ZTF_SERVER_RESTARTED, "ZTF_SERVER_RESTARTED"},
      {ZTF_PROTOCOL, "ZTF_PROTOCOL"},
      {ZTF_SERVER_BUSY, "ZTF_SERVER_BUSY"},
      {ZTF_ACCESS_DENIED, "ZTF_ACCESS_DENIED"},
      {ZTF_NOT_DURABLE, "ZTF_NOT_DURABLE"},
      {ZTF_READ_ONLY, "ZTF_READ_ONLY"},
      {ZTF_GAP, "ZTF_GAP"},
      {ZTF_SERVER_STARTING, "ZTF_SERVER_STARTING"},
      {ZTF_STALE_FRAME, "ZTF_STALE_FRAME"},
      {ZTF_BUFFER_TOO_SMALL, "ZTF_BUFFER_TOO_SMALL"}};
  for (const auto& [known, name] : kNames)
    if (code == known) return name;
  return "unknown";
}

ztf_code ztf_tree_create(const ztf_options* options, ztf_tree** tree, ztf_error* error) {
  return guarded(nullptr, error, [&] {
    auto made = std::make_unique<ztf_tree>();
    made->own = std::make_unique<Tree>(options_of(options));
    *tree = made.release();
    return Code::ok;
  });
}

ztf_code ztf_tree_open(const char* name, const char* folder, int64_t timeout_ns, ztf_tree** tree,
                       ztf_error* error) {
  return guarded(nullptr, error, [&] {
    auto made = std::make_unique<ztf_tree>();
    made->server =
        std::make_unique<ServerTree>(text_of(name, "name"), folder ? folder : "", timeout_ns);
    *tree = made.release();
    return Code::ok;
  });
}

void ztf_tree_close(ztf_tree* tree) { delete tree; }

ztf_code ztf_server_state(const ztf_tree* tree, ztf_server* server, ztf_error* error) {
  return guarded(tree, error, [&] {
    if (!tree->server) reject(Code::invalid_argument, "the tree is no server's", "tree");
    return tree->server->read([&](const SharedTree& of, std::uint64_t) {
      ztf_server state{0, tree->server->times_mapped(), of.lease_ns() - monotonic_ns(), {}};
      copy_text(of.options().instance, state.instance);
      write_sized(state, server);
      return Code::ok;
    });
  });
}

ztf_code ztf_lookup(const ztf_tree* tree, const char* target, const char* source, int64_t stamp_ns,
                    const ztf_lookup_options* options, ztf_answer* answer, ztf_error* error) {
  return guarded(tree, error, [&] {
    NamedQuery query = query_of(stamp_ns == kNoStamp ? Op::latest_common : Op::at, target, source);
    query.stamp = stamp_ns;
    return Code(run(tree, query, options, answer, error));
  });
}

ztf_code ztf_lookup_full(const ztf_tree* tree, const char* target, int64_t target_stamp_ns,
                         const char* source, int64_t source_stamp_ns, const char* fixed,
                         const ztf_lookup_options* options, ztf_answer* answer, ztf_error* error) {
  return guarded(tree, error, [&] {
    NamedQuery query = query_of(Op::full, target, source);
    query.fixed_name = name_of(fixed, "fixed");
    query.stamp = target_stamp_ns;
    query.source_stamp = source_stamp_ns;
    return Code(run(tree, query, options, answer, error));
  });
}

int32_t ztf_can(const ztf_tree* tree, const char* target, const char* source, int64_t stamp_ns,
                const ztf_lookup_options* options) {
  return ztf_lookup(tree, target, source, stamp_ns, options, nullptr, nullptr) == ZTF_OK;
}

ztf_code ztf_latest(const ztf_tree* tree, const char* target, const char* source,
                    ztf_answer* answer, ztf_error* error) {
  return look_up_op(Op::latest, tree, target, source, answer, error);
}

ztf_code ztf_latest_xact(const ztf_tree* tree, const char* target, const char* source,
                         ztf_answer* answer, ztf_error* error) {
  return look_up_op(Op::latest_xact, tree, target, source, answer, error);
}

ztf_code ztf_common_time(const ztf_tree* tree, const char* target, const char* source,
                         int64_t* stamp_ns, ztf_error* error) {
  ztf_answer answer{sizeof answer, {}, 0, 0, 0};
  const ztf_code code = look_up_op(Op::common_time, tree, target, source, &answer, error);
  *stamp_ns = answer.stamp_ns;
  return code;
}

ztf_code ztf_resolve(const ztf_tree* tree, const char* name, ztf_frame* frame, ztf_error* error) {
  return guarded(tree, error, [&] {
    const std::string_view text = name_of(name, "name");
    return read(tree, [&](const auto& of, std::uint64_t number) {
      const NameRef ref = of.find_ref(text);
      if (ref.id == 0) throw unknown_frame(of, text);
      *frame = {number, ref.id, ref.generation};
      return Code::ok;
    });
  });
}

ztf_code ztf_lookup_ref(const ztf_tree* tree, ztf_op op, const ztf_frame* target,
                        const ztf_frame* source, int64_t stamp_ns, ztf_answer* out,
                        ztf_error* error) {
  return guarded(tree, error, [&] {
    const Op kind = op_of(op, stamp_ns);
    return read(tree, [&](const auto& of, std::uint64_t number) {
      if (target->tree != number || source->tree != number) return stale(error);
      Answer answer;
      of.lookup(query_of(of, kind, *target, *source, stamp_ns), answer);
      if (!is_current(of, number, *target) || !is_current(of, number, *source)) return stale(error);
      if (answer.failure.code != Code::ok)
        return fail_ref(of, kind, *target, *source, answer.failure, error);
      set_answer(answer, out);
      return Code::ok;
    });
  });
}

ztf_code ztf_lookup_times(const ztf_tree* tree, const ztf_frame* target, const ztf_frame* source,
                          const int64_t* stamps_ns, size_t count, ztf_pose* poses, int32_t* codes,
                          ztf_error* error) {
  return guarded(tree, error, [&] {
    return read(tree, [&](const auto& of, std::uint64_t number) {
      if (target->tree != number || source->tree != number) return stale(error);
      constexpr std::size_t kTogether = SampleBlock::kRows;
      Query queries[kTogether];
      Answer answers[kTogether];
      for (std::size_t first = 0; first < count; first += kTogether) {
        const std::size_t some = std::min(kTogether, count - first);
        for (std::size_t i = 0; i < some; ++i)
          queries[i] = query_of(of, op_of(ZTF_AT, stamps_ns[first + i]), *target, *source,
                                stamps_ns[first + i]);
        of.lookup_batch({queries, some}, {answers, some});
        if (!is_current(of, number, *target) || !is_current(of, number, *source))
          return stale(error);
        for (std::size_t i = 0; i < some; ++i) {
          poses[first + i] = pose_of(answers[i].pose);
          codes[first + i] = code_of(shown_code(answers[i].failure, !of.startup().is_over()));
        }
      }
      return Code::ok;
    });
  });
}

ztf_code ztf_lookup_xact(const ztf_tree* tree, ztf_op op, const ztf_frame* targets,
                         const ztf_frame* sources, size_t count, int64_t stamp_ns, ztf_pose* poses,
                         int64_t* stamps_ns, ztf_error* error) {
  return guarded(tree, error, [&] {
    const Op asked = op_of(op, stamp_ns), kind = asked == Op::latest ? Op::latest_xact : asked;
    return read(tree, [&](const auto& of, std::uint64_t number) {
      SmallVector<Query, 16> queries;
      SmallVector<Answer, 16> answers;
      (void)answers.append(count);
      for (std::size_t i = 0; i < count; ++i) {
        if (targets[i].tree != number || sources[i].tree != number) return stale(error);
        queries.push_back(query_of(of, kind, targets[i], sources[i], stamp_ns));
        answers[i] = {};
      }
      ReadSet reads;
      of.lookup_transaction({queries.begin(), count}, {answers.begin(), count}, reads);
      for (std::size_t i = 0; i < count; ++i)
        if (!is_current(of, number, targets[i]) || !is_current(of, number, sources[i]))
          return stale(error);
      for (std::size_t i = 0; i < count; ++i) {
        const Failure& failure = answers[i].failure;
        if (failure.code != Code::ok)
          return fail_ref(of, kind, targets[i], sources[i], failure, error);
        poses[i] = pose_of(answers[i].pose);
        stamps_ns[i] = answers[i].stamp;
      }
      return Code::ok;
    });
  });
}

ztf_code ztf_frames(const ztf_tree* tree, char* buffer, size_t size, size_t* needed,
                    ztf_error* error) {
  return guarded(tree, error, [&] {
    const auto names = read(tree, [&](const auto& of, std::uint64_t) {
      std::vector<std::string> all;
      for (FrameId id = 1, n = of.size(); id <= n; ++id)
        if (!of.removed(id)) all.push_back(of.name(id));
      if constexpr (requires { of.check_lease(); }) of.check_lease();
      return all;
    });
    return write_names(names, buffer, size, needed);
  });
}

ztf_code ztf_parent(const ztf_tree* tree, const char* frame, int64_t stamp_ns, char* buffer,
                    size_t size, size_t* needed, ztf_error* error) {
  return guarded(tree, error, [&] {
    const std::string_view name = name_of(frame, "frame");
    const auto names = read(tree, [&](const auto& of, std::uint64_t) {
      return of.read_names([&] {
        const FrameId parent = of.parent(known(of, name), stamp_ns);
        return parent == 0 ? std::vector<std::string>() : std::vector{of.name(parent)};
      });
    });
    return write_names(names, buffer, size, needed);
  });
}

ztf_code ztf_chain(const ztf_tree* tree, const char* target, const char* source, int64_t stamp_ns,
                   char* buffer, size_t size, size_t* needed, ztf_error* error) {
  return guarded(tree, error, [&] {
    NamedQuery query = query_of(Op::at, target, source);
    query.stamp = stamp_ns;
    std::vector<std::string> names;
    read(tree, [&](const auto& of, std::uint64_t) {
      const Failure failure = chain(of, query, names);
      if (failure.code != Code::ok) throw lookup_error(of, failure, query);
    });
    return write_names(names, buffer, size, needed);
  });
}

ztf_code ztf_info(const ztf_tree* tree, const char* frame, ztf_frame_info* info, ztf_error* error) {
  return guarded(tree, error, [&] {
    const std::string_view name = name_of(frame, "frame");
    return read(tree, [&](const auto& of, std::uint64_t) {
      const ztf_frame_info found = of.read_names([&] {
        const FrameInfo i = of.info(known(of, name));
        ztf_frame_info out{0, 0, 0, kNoStamp, kNoStamp, {}, {}};
        if (i.parent == 0) return out;
        out.flags = i.is_static ? ZTF_STATIC : 0;
        out.samples = i.is_static ? 1 : i.samples;
        out.oldest_stamp_ns = i.is_static ? i.newest : i.oldest;
        out.newest_stamp_ns = i.newest;
        copy_text(of.name(i.parent), out.parent);
        copy_text(std::string(of.authority(i.authority)), out.authority);
        return out;
      });
      write_sized(found, info);
      return Code::ok;
    });
  });
}

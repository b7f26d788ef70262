// The writes of include/zenoh_tf/zenoh_tf.h, and transactions: commits of this process's tree, or
// requests to the server of a mapped one.
#include <string>
#include <vector>

#include "base/small_vector.hpp"
#include "by_name/errors.hpp"
#include "by_name/rows.hpp"
#include "c_api/calls.hpp"
#include "commits/validation.hpp"

// The reads of a transaction, and the rows that it will write.
struct ztf_transaction {
  ztf_tree* tree;
  std::uint64_t number = 0;  // of the tree that was read; 0: nothing was read
  std::vector<std::string> names = {};
  std::vector<ztf::Row> rows = {};
  // What was read: each name once, its frame, or 0, and the version, which is then 0 too.
  std::vector<std::string> read_names = {};
  std::vector<ztf::FrameId> read_frames = {};
  std::vector<ztf::Version> read_versions = {};
};

namespace ztf::c_api {

namespace {

constexpr auto kConflict = Code::conflict;

// Runs write(tree) for a tree of this process, or write(writes, instance) for a server's.
template <class Own, class OfServer>
void write(ztf_tree* tree, Own&& own, OfServer&& of_server) {
  if (tree->own) return own(*tree->own);
  if (!tree->writes)
    reject(kReadOnly, "the tree is a server's: give it ztf_write_through() to write to it");
  const std::string instance =
      tree->server->read([](const SharedTree& of, std::uint64_t) { return of.options().instance; });
  of_server(*tree->writes, instance);
}

void commit(ztf_tree* tree, const CommitRequest& request, std::span<std::uint8_t> results) {
  write(
      tree, [&](Tree& own) { own.commit(request, results); },
      [&](ServerWrites& writes, const std::string& instance) {
        writes.commit(request, results, instance);
      });
}

Code set_all(ztf_tree* tree, const ztf_transform* transforms, std::size_t count,
             const char* authority, std::int32_t flags, bool drop_old, std::int32_t* stored) {
  SmallVector<std::string_view, 32> names;
  SmallVector<Row, 16> rows;
  SmallVector<std::uint8_t, 16> results;
  (void)results.append(count);
  for (std::size_t i = 0; i < count; ++i) {
    const ztf_transform& t = transforms[i];
    const auto at = static_cast<std::uint32_t>(2 * i);
    names.push_back(text_of(t.parent, "parent"));
    names.push_back(text_of(t.child, "child"));
    rows.push_back({at, at + 1, t.stamp_ns, pose_of(t.pose)});
  }
  commit(tree,
         {.names = {names.begin(), names.size()},
          .rows = {rows.begin(), rows.size()},
          .authority = authority ? authority : "",
          .is_static = (flags & ZTF_STATIC) != 0,
          .drop_old = drop_old},
         {results.begin(), results.size()});
  if (stored) *stored = results[0] == RowResult::stored;
  return Code::ok;
}

// The names of a server's link, as the server commits by names. Throws Rejected if it has none.
std::vector<std::string> names_of_link(const ServerTree& server, const ztf_frame& parent,
                                       const ztf_frame& child) {
  return server.read([&](const SharedTree& of, std::uint64_t number) {
    const NameRef refs[] = {ref_of(parent, number), ref_of(child, number)};
    std::vector<std::string> names;
    for (const NameRef& ref : refs) {
      names.push_back(of.name(ref.id));
      if (!of.is_current(ref) || of.removed(ref.id)) reject_stale();
    }
    if (const FrameId now = of.parent(refs[1].id, kNoStamp); now != 0 && now != refs[0].id)
      reject(Code::invalid_argument, "the frame has another parent now", "parent_frame");
    return names;
  });
}

Code append(ztf_tree* tree, const ztf_frame& parent, const ztf_frame& child,
            const std::int64_t* stamps, const ztf_pose* poses, std::size_t count,
            const char* authority, std::size_t* stored) {
  SmallVector<Row, 16> rows;
  SmallVector<std::uint8_t, 16> results;
  (void)results.append(count);
  Row* row = rows.append(count);
  for (std::size_t i = 0; i < count; ++i) *row++ = {0, 1, stamps[i], pose_of(poses[i])};
  CommitRequest request{.names = {},
                        .rows = {rows.begin(), rows.size()},
                        .authority = authority ? authority : "",
                        .drop_old = true};
  const std::span<std::uint8_t> done(results.begin(), results.size());
  if (tree->own) {
    const NameRef frames[] = {ref_of(parent, tree->number), ref_of(child, tree->number)};
    request.frames = frames;
    tree->own->commit(request, done);
  } else {
    const std::vector<std::string> texts = names_of_link(*tree->server, parent, child);
    const std::string_view names[] = {texts[0], texts[1]};
    request.names = names;
    commit(tree, request, done);
  }
  if (stored) *stored = static_cast<std::size_t>(std::ranges::count(done, RowResult::stored));
  return Code::ok;
}

// --- transactions

void note_read(ztf_transaction& t, std::string_view name, FrameId frame, Version version) {
  if (std::ranges::find(t.read_names, name) != t.read_names.end()) return;
  t.read_names.emplace_back(name);
  t.read_frames.push_back(frame);
  t.read_versions.push_back(version);
}

// Whether all that was read still holds. After a lookup: what was read before it held while it ran,
// as versions only grow, so all lookups of the transaction show the state of one instant.
template <class AnyTree>
bool still_holds(const ztf_transaction& t, const AnyTree& tree) {
  for (std::size_t i = 0; i < t.read_names.size(); ++i) {
    const FrameId frame = t.read_frames[i];
    if (frame == 0 ? tree.find(t.read_names[i]) != 0
                   : tree.info(frame).version != t.read_versions[i])
      return false;
  }
  return true;
}

template <class AnyTree>
Code look_up(ztf_transaction& t, const AnyTree& tree, std::uint64_t number, Op op,
             std::string_view target, std::string_view source, Stamp stamp, ztf_answer* out) {
  if (t.number != 0 && t.number != number)
    reject(kConflict, "another server has the tree since the transaction's first lookup");
  t.number = number;
  LookupRows rows({target, source});
  const auto kind = static_cast<std::uint8_t>(op);
  const std::uint32_t indexes[] = {0, 1};
  rows.size = 1;
  rows.op = {&kind}, rows.target = {&indexes[0]}, rows.source = {&indexes[1]};
  rows.stamp = {&stamp};
  (void)rows.find_names(tree);
  Answer answer;
  const std::vector<ReadVersion> reads =
      rows.look_up_with_versions(tree, true, {&answer, 1}, kNoReadLimit);
  for (const ReadVersion& read : reads)
    note_read(t, tree.name(read.frame), read.frame, read.version);
  for (const std::string_view name : rows.unknown_names()) note_read(t, name, 0, 0);
  if (!still_holds(t, tree)) reject(kConflict, "what the transaction has read was changed");
  if (answer.failure.code != Code::ok)
    throw lookup_error(tree, answer.failure, target, source, {}, op == Op::latest_common);
  set_answer(answer, out);
  return Code::ok;
}

void clear(ztf_transaction& t) {
  t.number = 0;
  t.names.clear(), t.rows.clear(), t.read_names.clear(), t.read_frames.clear(),
      t.read_versions.clear();
}

Code commit(ztf_transaction& t, const char* authority, std::int32_t flags) {
  const auto views = [](const std::vector<std::string>& texts) {
    return std::vector<std::string_view>(texts.begin(), texts.end());
  };
  // A read set of another server's tree would be compared with versions that mean something else.
  if (t.number != 0 && t.number != read(t.tree, [](const auto&, std::uint64_t n) { return n; }))
    reject(kConflict, "another server has the tree since the transaction's first lookup");
  const std::vector<std::string_view> names = views(t.names), read_names = views(t.read_names);
  std::vector<std::uint8_t> results(t.rows.size());
  if (t.rows.empty()) return Code::ok;
  commit(t.tree,
         {.names = names,
          .rows = t.rows,
          .authority = authority ? authority : "",
          .is_static = (flags & ZTF_STATIC) != 0,
          .read_names = read_names,
          .read_versions = t.read_versions},
         results);
  return Code::ok;
}

}  // namespace

}  // namespace ztf::c_api

using namespace ztf;
using namespace ztf::c_api;

void ztf_reply_set(ztf_reply* reply, const void* bytes, size_t size) {
  try {
    reply->bytes.assign(static_cast<const char*>(bytes), size);
  } catch (const std::bad_alloc&) {
    reply->is_lost = true;
  }
}

ztf_code ztf_write_through(ztf_tree* tree, ztf_query_fn query, void* context, int64_t timeout_ns,
                           ztf_error* error) {
  return guarded(tree, error, [&] {
    if (!tree->server) reject(Code::invalid_argument, "the tree is no server's", "tree");
    if (tree->writes) reject(Code::invalid_argument, "the tree has a way to write already", "tree");
    if (!query) reject(Code::invalid_argument, "query is NULL", "query");
    constexpr std::int64_t kMostNs = 600'000'000'000;  // the protocol's
    if (timeout_ns <= 0 || timeout_ns > kMostNs)
      reject(Code::invalid_argument, "timeout_ns must be above 0 and at most 600 s", "timeout_ns");
    tree->writes = std::make_unique<ServerWrites>(tree->server->name(), query, context, timeout_ns);
    return Code::ok;
  });
}

ztf_code ztf_set(ztf_tree* tree, const ztf_transform* transform, const char* authority,
                 int32_t flags, int32_t* stored, ztf_error* error) {
  return guarded(tree, error,
                 [&] { return set_all(tree, transform, 1, authority, flags, true, stored); });
}

ztf_code ztf_set_xact(ztf_tree* tree, const ztf_transform* transforms, size_t count,
                      const char* authority, int32_t flags, ztf_error* error) {
  return guarded(tree, error, [&] {
    return set_all(tree, transforms, count, authority, flags, false, nullptr);
  });
}

ztf_code ztf_append(ztf_tree* tree, const ztf_frame* parent, const ztf_frame* child,
                    const int64_t* stamps_ns, const ztf_pose* poses, size_t count,
                    const char* authority, size_t* stored, ztf_error* error) {
  return guarded(tree, error, [&] {
    return append(tree, *parent, *child, stamps_ns, poses, count, authority, stored);
  });
}

ztf_code ztf_clear(ztf_tree* tree, int32_t keep_static, ztf_error* error) {
  return guarded(tree, error, [&] {
    write(
        tree, [&](Tree& own) { own.clear(keep_static != 0); },
        [&](ServerWrites& writes, const std::string& instance) {
          writes.clear(keep_static != 0, instance);
        });
    return Code::ok;
  });
}

ztf_code ztf_remove_frame(ztf_tree* tree, const char* frame, int32_t subtree, ztf_error* error) {
  return guarded(tree, error, [&] {
    const std::string_view name = name_of(frame, "frame");
    write(
        tree, [&](Tree& own) { own.remove_frame(name, subtree != 0); },
        [&](ServerWrites& writes, const std::string& instance) {
          writes.remove_frame(name, subtree != 0, instance);
        });
    return Code::ok;
  });
}

ztf_code ztf_transaction_begin(ztf_tree* tree, ztf_transaction** transaction, ztf_error* error) {
  return guarded(tree, error, [&] {
    *transaction = new ztf_transaction{tree};
    return Code::ok;
  });
}

ztf_code ztf_transaction_lookup(ztf_transaction* t, ztf_op op, const char* target,
                                const char* source, int64_t stamp_ns, ztf_answer* answer,
                                ztf_error* error) {
  return guarded(t->tree, error, [&] {
    const std::string_view to = name_of(target, "target"), from = name_of(source, "source");
    const Op kind = op_of(op, stamp_ns);
    return read(t->tree, [&](const auto& of, std::uint64_t number) {
      return look_up(*t, of, number, kind == Op::latest ? Op::latest_xact : kind, to, from,
                     stamp_ns, answer);
    });
  });
}

ztf_code ztf_transaction_set(ztf_transaction* t, const ztf_transform* transform, ztf_error* error) {
  return guarded(t->tree, error, [&] {
    const std::string_view parent = text_of(transform->parent, "parent"),
                           child = text_of(transform->child, "child");
    const auto at = static_cast<std::uint32_t>(t->names.size());
    t->names.reserve(at + 2), t->rows.reserve(t->rows.size() + 1);
    t->names.emplace_back(parent), t->names.emplace_back(child);
    t->rows.push_back({at, at + 1, transform->stamp_ns, pose_of(transform->pose)});
    return Code::ok;
  });
}

ztf_code ztf_transaction_commit(ztf_transaction* t, const char* authority, int32_t flags,
                                ztf_error* error) {
  const ztf_code code = guarded(t->tree, error, [&] { return commit(*t, authority, flags); });
  clear(*t);
  return code;
}

void ztf_transaction_end(ztf_transaction* t) { delete t; }

// Tree._read_rows: lookups of every kind as columns, for the server.
//
// GIL: many rows release it, once for all that is done row by row, so that other threads wait for
// none of it. Names are resolved before, under it, and errors are made after.
#include "bindings/reads/read_rows.hpp"

#include <algorithm>

#include "base/host.hpp"
#include "records/versions.hpp"

namespace ztf {

namespace {

constexpr std::size_t kReleaseFrom = 16;  // rows from which releasing the GIL pays

constexpr std::size_t kRowsAtOnce = 128;

constexpr std::size_t kMaxQuoted = 64;  // bytes of a name in an error about its length

// Each frame once, in the version that was read first: if a later row read another version, the
// frame has changed, and the transaction conflicts in any case.
class FirstReads {
 public:
  void add(const ReadSet& reads) {
    for (const ReadVersion& read : reads) {
      if (read.frame >= seen_.size()) seen_.resize(2 * std::size_t{read.frame} + 64);
      if (seen_[read.frame]) continue;
      seen_[read.frame] = true;
      list_.push_back(read);
    }
  }
  [[nodiscard]] const std::vector<ReadVersion>& list() const noexcept { return list_; }

 private:
  std::vector<bool> seen_;  // by frame
  std::vector<ReadVersion> list_;
};

// The read set: names of frames and their versions. A frame that does not exist has version 0:
// a transaction conflicts if it is created.
template <class AnyTree>
nb::object versions_of(const AnyTree& tree, const ReadRows& rows,
                       const std::vector<ReadVersion>& read_set, Budget* budget) {
  if (budget) {
    std::uint64_t bytes = 0;
    for (const ReadVersion& r : read_set) bytes += tree.name(r.frame).size() + 11;
    for (std::size_t i = 0; i < rows.frames.size(); ++i)
      if (rows.frames[i].id == 0) bytes += rows.texts[i].size() + 11;
    budget->reply_bytes.take(bytes);
  }
  nb::list read_names;
  for (const ReadVersion& r : read_set) read_names.append(str_of(tree.name(r.frame)));
  std::size_t unknown = 0;
  for (std::size_t i = 0; i < rows.frames.size(); ++i)
    if (rows.frames[i].id == 0 && !rows.invalid_name[i]) {
      read_names.append(rows.name_objects[i]);
      ++unknown;
    }
  return nb::make_tuple(read_names,
                        make_array<Version>({read_set.size() + unknown}, [&](Version* d) {
                          for (const ReadVersion& r : read_set) *d++ = r.version & kServerVersion;
                          std::fill(d, d + unknown, Version{0});
                        }));
}

// Looks up all rows as one transaction, or each as one of its own, and collects what they read if
// `read_set` is not null. Throws Rejected if an atomic lookup, or the read set, has more than
// `max_reads` frames.
template <class AnyTree>
void look_up_xact(const AnyTree& tree, ReadRows& rows, bool atomic, std::size_t max_reads,
                  std::vector<Answer>& answers, FirstReads* read_set) {
  ReadSet reads;
  if (atomic) {
    for (bool is_current = false; !is_current;) {
      std::optional<Rejected> rejection;  // it may rest on other names' frames, as an answer may
      try {
        tree.lookup_transaction(rows.queries, answers, reads, max_reads);
      } catch (const Rejected& rejected) {
        rejection = rejected;
      }
      is_current = rows.find_names_again(tree);
      if (is_current && rejection) throw *rejection;
    }
    if (read_set) read_set->add(reads);
  } else {
    for (std::size_t i = 0; i < answers.size(); ++i) {
      rows.look_up_row(tree, i, [&](const Query& query) {
        tree.lookup_transaction({&query, 1}, {&answers[i], 1}, reads);
      });
      read_set->add(reads);
      if (read_set->list().size() > max_reads)
        throw Rejected{.code = Code::limit, .message = "the read set has too many frames"};
    }
  }
}

// Looks up each row by itself, and calls add(first row, answers) for some rows at a time: their
// answers then stay in the processor's cache.
template <class AnyTree, class Add>
void look_up_each(const AnyTree& tree, ReadRows& rows, Add&& add) {
  std::vector<Answer> answers(std::min(kRowsAtOnce, rows.queries.size()));
  bool ids_are_current = true;  // of the queries
  for (std::size_t first = 0; first < rows.queries.size(); first += answers.size()) {
    const std::size_t count = std::min(answers.size(), rows.queries.size() - first);
    const std::span<Answer> some = std::span(answers).first(count);
    for (Answer& answer : some) answer.stamp = answer.newest = 0;  // not all lookups set them
    if (ids_are_current) {
      tree.lookup_batch(std::span(rows.queries).subspan(first, count), some);
      ids_are_current =
          std::ranges::all_of(rows.frames, [&](FrameRef frame) { return tree.is_current(frame); });
    }
    for (std::size_t i = 0; i < count && !ids_are_current; ++i)
      rows.look_up_row(tree, first + i, [&](const Query& query) { tree.lookup(query, some[i]); });
    add(first, some);
  }
}

// Counts the rows that failed because a link was late. Only lookups of a server's clients are
// counted: those that have a budget.
void count_failed(const Tree& tree, std::span<const Answer> answers) {
  const std::int64_t now_ns = real_time_ns();
  for (const Answer& answer : answers) tree.count_failed(answer.failure, now_ns);
}

template <class AnyTree>
nb::tuple read_rows(const AnyTree& tree, nb::handle names, const Column<std::uint8_t>& op,
                    const Column<std::uint32_t>& target, const Column<std::uint32_t>& source,
                    const Column<Stamp>& stamp, const std::optional<Column<std::uint32_t>>& fixed,
                    const std::optional<Column<Stamp>>& source_stamp, bool atomic, bool versions,
                    bool errors, Budget* budget, Stamp max_gap) {
  const ReadColumns columns{op, target, source, stamp, fixed, source_stamp, max_gap};
  ReadRows rows(tree, names, columns);
  const FailureReport report{{}, !tree.startup().is_over(), errors, budget};
  FirstReads read_set;
  std::uint64_t links = 0;
  const std::uint64_t max_links = budget ? budget->links.left() : 0;
  const std::size_t max_reads = budget ? budget->read_set.limit() : kNoReadLimit;
  std::optional<AnswerColumns> answered;
  const auto run = [&] {
    rows.set(columns);
    if (versions)  // one instant per row, so that its versions belong together
      for (Query& q : rows.queries)
        if (q.op == Op::latest) q.op = Op::latest_xact;
    if (budget) links = rows.links(tree, max_links);
    if (links > max_links) return;
    answered.emplace(rows.queries.size(), report);
    const auto add = [&](std::size_t first, std::span<const Answer> answers) {
      [[maybe_unused]] const bool any_failed = answered->add(rows, first, answers);
      if constexpr (std::is_same_v<AnyTree, Tree>)
        if (budget && any_failed) count_failed(tree, answers);
    };
    if (!atomic && !versions) return look_up_each(tree, rows, add);
    std::vector<Answer> answers(rows.queries.size());
    look_up_xact(tree, rows, atomic, max_reads, answers, versions ? &read_set : nullptr);
    add(0, answers);
  };
  try {
    if (op.shape(0) >= kReleaseFrom) {
      const GilReleased released;
      run();
    } else {
      const GilReleasedOnWait released;
      run();
    }
  } catch (const Rejected& rejected) {
    if (budget && rejected.code == Code::limit) budget->read_set.exhausted();
    raise(make_error(rejected));
  }
  if (budget) budget->links.take(links);
  const nb::object reads = versions ? versions_of(tree, rows, read_set.list(), budget) : nb::none();
  return reply(tree, rows, std::move(*answered), report, reads);
}

Rejected malformed(std::string message, const char* field) {
  return {.code = Code::invalid_argument, .message = std::move(message), .field = field};
}

template <class AnyTree>
[[noreturn]] void raise_too_long(const AnyTree& tree, std::string_view name) {
  std::size_t end = kMaxQuoted;
  while (end > 0 && (static_cast<unsigned char>(name[end]) & 0xc0) == 0x80) --end;
  nb::dict facts;
  facts["field"] = "max_name_bytes";
  facts["limit"] = tree.options().max_name_bytes;
  facts["value"] = name.size();
  raise(make_error(Code::limit,
                   "the name " + quoted(std::string(name.substr(0, end)) + "...") + " has " +
                       std::to_string(name.size()) + " bytes: the limit is " +
                       std::to_string(tree.options().max_name_bytes) + " (max_name_bytes)",
                   facts));
}

}  // namespace

template <class AnyTree>
std::vector<nb::object> names_of(const AnyTree& tree, nb::handle names,
                                 std::vector<std::string_view>& texts, const char* field) {
  std::vector<nb::object> objects;
  for (const nb::handle item : tuple_of(names)) {
    texts.push_back(text_of(item, field));
    objects.push_back(nb::borrow(item));
  }
  check_name_bytes(tree, texts);
  return objects;
}

template <class AnyTree>
void check_name_bytes(const AnyTree& tree, std::span<const std::string_view> names) {
  // A commit strips one '/' in front.
  const std::size_t most = std::size_t{tree.options().max_name_bytes} + 1;
  for (const std::string_view name : names)
    if (name.size() > most) [[unlikely]]
      raise_too_long(tree, name);
}

template <class AnyTree>
ReadRows::ReadRows(const AnyTree& tree, nb::handle name_list, const ReadColumns& columns)
    : name_objects(names_of(tree, name_list, texts, "names")), invalid_name(name_objects.size()) {
  for (std::size_t i = 0; i < name_objects.size(); ++i) {
    try {
      frames.push_back(frame_of(tree, name_objects[i], "frame"));
    } catch (nb::python_error&) {
      invalid_name[i] = true;
      frames.emplace_back();
    }
  }
  const std::size_t n = columns.op.shape(0);
  fit(columns.target, n, "target");
  fit(columns.source, n, "source");
  fit(columns.stamp, n, "stamp_ns");
  if (columns.fixed) fit(*columns.fixed, n, "fixed");
  if (columns.source_stamp) fit(*columns.source_stamp, n, "source_stamp_ns");
}

void ReadRows::set(const ReadColumns& columns) {
  const std::size_t n = columns.op.shape(0);
  queries.resize(n);
  names.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    Query& q = queries[i];
    const std::uint8_t op = columns.op(i);
    if (op >= kOps)
      throw malformed("op must be below " + std::to_string(kOps) + ", not " + std::to_string(op),
                      "op");
    q.op = static_cast<Op>(op);
    names[i] = {checked(columns.target(i), frames.size(), "target"),
                checked(columns.source(i), frames.size(), "source"), 0};
    q.stamp = columns.stamp(i);
    q.max_gap = columns.max_gap;
    if (q.op == Op::at && q.stamp == kNoStamp)
      throw malformed("stamp_ns is -2^63; stamps are nanoseconds from -2^63 + 1 to 2^63 - 1",
                      "stamp_ns");
    if (q.op == Op::full) {
      if (!columns.fixed || !columns.source_stamp)
        throw malformed("a full lookup needs fixed and source_stamp_ns", "fixed");
      names[i].fixed = checked((*columns.fixed)(i), frames.size(), "fixed");
      q.source_stamp = (*columns.source_stamp)(i);
    }
  }
  set_query_ids();
}

void ReadRows::set_query_ids() {
  for (std::size_t i = 0; i < queries.size(); ++i) set_query_ids(i);
}

void ReadRows::set_query_ids(std::size_t row) {
  Query& query = queries[row];
  query.target = frames[names[row].target].id;
  query.source = frames[names[row].source].id;
  if (query.op == Op::full) query.fixed = frames[names[row].fixed].id;
}

template <class AnyTree>
bool ReadRows::find_names_again(const AnyTree& tree) {
  bool unchanged = true;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const FrameRef frame = invalid_name[i] ? FrameRef() : tree.find_ref(texts[i]);
    unchanged &= frame == frames[i];
    frames[i] = frame;
  }
  if (!unchanged) set_query_ids();
  return unchanged;
}

template <class AnyTree>
bool ReadRows::find_lost_names(const AnyTree& tree, std::size_t row) {
  bool none = true;
  for (const std::uint32_t name : {names[row].target, names[row].source, names[row].fixed}) {
    if (tree.is_current(frames[name])) continue;
    frames[name] = tree.find_ref(texts[name]);
    none = false;
  }
  return none;
}

template <class AnyTree>
std::uint64_t ReadRows::links(const AnyTree& tree, std::uint64_t most) const {
  constexpr std::uint32_t kUnknown = 0xffffffff;
  std::vector<std::uint32_t> depths(frames.size(), kUnknown);
  const auto depth_of = [&](std::uint32_t name) {
    std::uint32_t& depth = depths[name];
    if (depth == kUnknown) {
      depth = 0;
      for (FrameId id = frames[name].id; id != 0 && depth <= tree.options().max_path(); ++depth)
        id = tree.parent(id, kNoStamp);
    }
    return depth;
  };
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < queries.size() && total <= most; ++i) {
    total += 1 + depth_of(names[i].target) + depth_of(names[i].source);
    if (queries[i].op == Op::full) total += 2 * depth_of(names[i].fixed);
  }
  return total;
}

bool ReadRows::has_invalid_name(std::size_t row) const {
  const auto [target, source, fixed] = names[row];
  return invalid_name[target] || invalid_name[source] ||
         (queries[row].op == Op::full && invalid_name[fixed]);
}

template <class AnyTree>
nb::object ReadRows::name_error(const AnyTree& tree, std::size_t row) const {
  const auto [target, source, fixed] = names[row];
  try {
    (void)frame_of(tree, name_objects[target], "target_frame");
    (void)frame_of(tree, name_objects[source], "source_frame");
    (void)frame_of(tree, name_objects[fixed], "fixed_frame");
  } catch (nb::python_error& error) {
    return nb::borrow(error.value());
  }
  return nb::object();
}

void bind_operations(nb::module_& m) {
  m.attr("OP_AT") = static_cast<int>(Op::at);
  m.attr("OP_COMMON") = static_cast<int>(Op::latest_common);
  m.attr("OP_LATEST") = static_cast<int>(Op::latest);
  m.attr("OP_LATEST_XACT") = static_cast<int>(Op::latest_xact);
  m.attr("OP_COMMON_TIME") = static_cast<int>(Op::common_time);
  m.attr("OP_FULL") = static_cast<int>(Op::full);
  m.attr("NO_STAMP") = kNoStamp;
}

template <class T>
void bind_read_rows(nb::class_<T>& tree) {
  tree.def("_read_rows", method<&read_rows<T>>, nb::arg("names"), nb::arg("op"), nb::arg("target"),
           nb::arg("source"), nb::arg("stamp_ns"), nb::arg("fixed").none() = nb::none(),
           nb::arg("source_stamp_ns").none() = nb::none(), nb::kw_only(), nb::arg("atomic") = false,
           nb::arg("versions") = false, nb::arg("errors") = true,
           nb::arg("budget").none() = nb::none(), nb::arg("max_gap_ns") = kNoGapLimit);
}
template void bind_read_rows(nb::class_<Tree>&);
template void bind_read_rows(nb::class_<SharedTree>&);

// What the other files use.
template void check_name_bytes(const Tree&, std::span<const std::string_view>);
template std::vector<nb::object> names_of(const Tree&, nb::handle, std::vector<std::string_view>&,
                                          const char*);
template ReadRows::ReadRows(const Tree&, nb::handle, const ReadColumns&);
template std::uint64_t ReadRows::links(const Tree&, std::uint64_t) const;
template nb::object ReadRows::name_error(const Tree&, std::size_t) const;
template nb::object ReadRows::name_error(const SharedTree&, std::size_t) const;

}  // namespace ztf

#include "by_name/rows.hpp"

#include "shared/shared_tree.hpp"
#include "tree.hpp"

namespace ztf {

namespace {

[[noreturn]] void reject(std::string message, const char* field) {
  throw Rejected{.code = Code::invalid_argument, .message = std::move(message), .field = field};
}

// Each frame once.
class FirstReads {
 public:
  void add(const ReadSet& reads) {
    for (const ReadVersion& read : reads) {
      if (read.frame >= seen_.size()) seen_.resize(2 * std::size_t{read.frame} + 64);
      if (seen_[read.frame]) continue;
      seen_[read.frame] = true;
      list.push_back(read);
    }
  }

  std::vector<ReadVersion> list;

 private:
  std::vector<bool> seen_;  // by frame
};

}  // namespace

void LookupRows::check() const {
  for (std::size_t i = 0; i < size; ++i) {
    if (op[i] >= kOps)
      reject("op must be below " + std::to_string(kOps) + ", not " + std::to_string(op[i]), "op");
    check_index(target[i], names.size(), "target");
    check_index(source[i], names.size(), "source");
    const Op kind{op[i]};
    if (kind == Op::at && stamp[i] == kNoStamp)
      reject("stamp_ns is -2^63; stamps are nanoseconds from -2^63 + 1 to 2^63 - 1", "stamp_ns");
    if (kind != Op::full) continue;
    if (!fixed.values || !source_stamp.values)
      reject("a full lookup needs fixed and source_stamp_ns", "fixed");
    check_index(fixed[i], names.size(), "fixed");
  }
}

template <class AnyTree>
bool LookupRows::find_names(const AnyTree& tree) {
  ids_freed_ = tree.ids_freed();
  bool unchanged = true;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const NameRef ref = tree.find_ref(names[i]);
    unchanged &= ref == refs_[i];
    refs_[i] = ref;
  }
  return unchanged;
}

NamedQuery LookupRows::named(std::size_t row) const noexcept {
  NamedQuery named{query(row), names[target[row]], names[source[row]]};
  if (named.op == Op::full) named.fixed_name = names[fixed[row]];
  return named;
}

std::optional<Rejected> LookupRows::fault(std::size_t row) const {
  const NamedQuery of = named(row);
  std::optional<Rejected> fault = name_fault(of.target_name, "target_frame");
  if (!fault) fault = name_fault(of.source_name, "source_frame");
  if (!fault && of.op == Op::full) fault = name_fault(of.fixed_name, "fixed_frame");
  return fault;
}

std::vector<std::string_view> LookupRows::unknown_names() const {
  std::vector<std::string_view> unknown;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (refs_[i].id == 0 && is_frame_name(names[i])) unknown.push_back(names[i]);
  return unknown;
}

template <class AnyTree>
std::uint64_t LookupRows::links(const AnyTree& tree, std::uint64_t most) const {
  constexpr std::uint32_t kUnknown = 0xffffffff;
  std::vector<std::uint32_t> depths(names.size(), kUnknown);
  const auto depth_of = [&](std::uint32_t name) {
    std::uint32_t& depth = depths[name];
    if (depth == kUnknown) {
      depth = 0;
      for (FrameId id = refs_[name].id; id != 0 && depth <= tree.options().max_path(); ++depth)
        id = tree.parent(id, kNoStamp);
    }
    return depth;
  };
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < size && total <= most; ++i) {
    total += 1 + depth_of(target[i]) + depth_of(source[i]);
    if (Op{op[i]} == Op::full) total += 2 * depth_of(fixed[i]);
  }
  return total;
}

template <class AnyTree>
void LookupRows::look_up_at_once(const AnyTree& tree, std::span<Answer> answers, ReadSet& reads,
                                 std::size_t max_reads) {
  std::vector<Query> queries(size);
  for (bool is_current = false; !is_current;) {
    set(queries, 0);
    std::optional<Rejected> rejection;  // it may rest on other names' frames, as an answer may
    try {
      tree.lookup_transaction(queries, answers, reads, max_reads);
    } catch (const Rejected& rejected) {
      rejection = rejected;
    }
    // A frame that was created or removed meanwhile would be reported beside newer state of another
    // row.
    is_current = find_names(tree);
    if (is_current && rejection) throw *rejection;
  }
}

template <class AnyTree>
std::vector<ReadVersion> LookupRows::look_up_with_versions(const AnyTree& tree, bool at_once,
                                                           std::span<Answer> answers,
                                                           std::size_t max_reads) {
  FirstReads found;
  ReadSet reads;
  if (at_once) {
    look_up_at_once(tree, answers, reads, max_reads);
    found.add(reads);
    return std::move(found.list);
  }
  for (std::size_t i = 0; i < size; ++i) {
    look_up_row(tree, i, [&](const Query& query) {
      tree.lookup_transaction({&query, 1}, {&answers[i], 1}, reads);
    });
    found.add(reads);
    if (found.list.size() > max_reads)
      throw Rejected{.code = Code::limit, .message = "the read set has too many frames"};
  }
  return std::move(found.list);
}

template <class AnyTree>
bool LookupRows::find_lost_names(const AnyTree& tree, std::size_t row) {
  bool any = false;
  const auto find = [&](std::uint32_t name) {
    if (tree.is_current(refs_[name])) return;
    refs_[name] = tree.find_ref(names[name]);
    any = true;
  };
  find(target[row]);
  find(source[row]);
  if (Op{op[row]} == Op::full) find(fixed[row]);
  return any;
}

#define ZTF_OF_TREE(AnyTree)                                                             \
  template bool LookupRows::find_names(const AnyTree&);                                  \
  template std::uint64_t LookupRows::links(const AnyTree&, std::uint64_t) const;         \
  template void LookupRows::look_up_at_once(const AnyTree&, std::span<Answer>, ReadSet&, \
                                            std::size_t);                                \
  template std::vector<ReadVersion> LookupRows::look_up_with_versions(                   \
      const AnyTree&, bool, std::span<Answer>, std::size_t);                             \
  template bool LookupRows::find_lost_names(const AnyTree&, std::size_t);
ZTF_OF_TREE(Tree)
ZTF_OF_TREE(SharedTree)
#undef ZTF_OF_TREE

}  // namespace ztf

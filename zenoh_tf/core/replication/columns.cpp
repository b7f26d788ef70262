// How entries of the change log become columns.
#include "replication/columns.hpp"

namespace ztf {

ChangeTable changes_of(std::span<const LogEntryPtr> entries) {
  constexpr std::uint32_t kNone = ~std::uint32_t{0};
  ChangeTable table;
  std::vector<std::uint32_t> index;  // of the entry's names: an entry repeats few
  for (const LogEntryPtr& entry : entries) {
    index.assign(entry->names(), kNone);
    const auto name = [&](std::uint32_t i) {
      if (index[i] == kNone) index[i] = table.names.add(entry->name(i));
      return index[i];
    };
    for (const Change& change : *entry) {
      table.add(change.kind, name(change.frame), change.version);
      if (change.kind == ChangeKind::orphaned)
        table.lost.push_back(change.parent == kNoParent ? kNoParent : name(change.parent));
      if (has_sample(change.kind))
        table.add_sample(name(change.parent), table.authorities.add(entry->authority()),
                         change.stamp, change.pose);
    }
  }
  return table;
}

}  // namespace ztf

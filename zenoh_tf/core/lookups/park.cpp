// Running a lookup, and parking it.
#include "lookups/park.hpp"

#include <algorithm>
#include <iterator>

#include "lookups/late.hpp"
#include "lookups/lookup.hpp"

namespace ztf {

bool lookup_or_park(const TreeState& tree, Waiter& waiter, std::size_t max_links) {
  // Copied, because a parked waiter may belong to another thread.
  const std::string_view names[] = {waiter.target_, waiter.source_, waiter.fixed_};
  for (;;) {
    Query& query = waiter.query_;
    const NameRef refs[] = {tree.names.find_ref(waiter.target_),
                            tree.names.find_ref(waiter.source_),
                            query.op == Op::full ? tree.names.find_ref(waiter.fixed_) : NameRef()};
    query.target = refs[0].id;
    query.source = refs[1].id;
    query.fixed = refs[2].id;
    ReadSet reads;
    lookup_transaction(tree, {&query, 1}, {&waiter.answer_, 1}, reads);
    if (!std::all_of(refs, std::end(refs), [&](auto ref) { return tree.names.is_current(ref); }))
      continue;
    const Failure& failure = waiter.answer_.failure;
    if (failure.code == Code::ok || !may_succeed_later(tree, failure)) return true;
    waiter.waited_for_ = find_late_link(tree, failure);
    tree.wait_list.park(waiter, reads, max_links);  // step W1 (waiting/wait_list.hpp)
    (void)tree.commit_count.sum();                  // step W2
    bool unchanged = true;
    for (const ReadVersion& read : reads) unchanged &= tree.version(read.frame) == read.version;
    for (int i = 0; i < 3; ++i)
      unchanged &= names[i].empty() || tree.names.find_ref(names[i]) == refs[i];
    // If something changed, a commit came in between. If that has woken the waiter already,
    // cancel() fails, and the waiter belongs to the woken thread.
    if (unchanged || !tree.wait_list.cancel(waiter)) return false;
  }
}

}  // namespace ztf

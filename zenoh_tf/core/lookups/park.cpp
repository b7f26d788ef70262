// Running a lookup, and parking it.
#include "lookups/park.hpp"

#include <algorithm>
#include <iterator>

#include "lookups/late.hpp"
#include "lookups/lookup.hpp"

namespace ztf {

namespace {

// Whether a lookup is of two times, both known. If one half fails for good, so does the lookup,
// although its answer reports the half that fails first.
bool has_two_times(const Query& query) noexcept {
  return query.op == Op::full && query.stamp != kNoStamp && query.source_stamp != kNoStamp;
}

}  // namespace

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
    ReadSet half_reads[2];
    if (has_two_times(query) && waiter.answer_.failure.code != Code::ok) {
      const Query halves[] = {{Op::at, query.fixed, query.source, query.source_stamp},
                              {Op::at, query.target, query.fixed, query.stamp}};
      for (int i = 0; i < 2; ++i) {
        Answer half;
        lookup_transaction(tree, {&halves[i], 1}, {&half, 1}, half_reads[i]);
        if (half.failure.code == Code::ok || may_succeed_later(tree, half.failure)) continue;
        waiter.answer_ = half;
        waiter.answer_.failure.source_half = i == 0;
      }
    }
    if (!std::all_of(refs, std::end(refs), [&](auto ref) { return tree.names.is_current(ref); }))
      continue;
    const Failure& failure = waiter.answer_.failure;
    if (failure.code == Code::ok || !may_succeed_later(tree, failure)) return true;
    waiter.waited_for_ = find_late_link(tree, failure);
    // Step W1 (waiting/wait_list.hpp).
    if (has_two_times(query)) {
      const WaitList::Part parts[] = {{half_reads[0], query.source_stamp, false},
                                      {half_reads[1], query.stamp, false}};
      tree.wait_list.park(waiter, parts, max_links);
    } else {
      const WaitList::Part part{reads, failure.stamp,
                                query.op == Op::latest_common || query.op == Op::full};
      tree.wait_list.park(waiter, {&part, 1}, max_links);
    }
    (void)tree.commit_count.sum();  // step W2
    bool unchanged = true;
    for (const ReadSet* set : {&reads, &half_reads[0], &half_reads[1]})
      for (const ReadVersion& read : *set) unchanged &= tree.version(read.frame) == read.version;
    for (int i = 0; i < 3; ++i)
      unchanged &= names[i].empty() || tree.names.find_ref(names[i]) == refs[i];
    // If something changed, a commit came in between. If that has woken the waiter already,
    // cancel() fails, and the waiter belongs to the woken thread.
    if (unchanged || !tree.wait_list.cancel(waiter)) return false;
  }
}

}  // namespace ztf

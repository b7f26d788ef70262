#include "store.hpp"

#include <algorithm>
#include <future>
#include <stdexcept>

#include "measure.hpp"

namespace bench {

const char* name_of(Read kind) {
  switch (kind) {
    case Read::common:
      return "latest-common";
    case Read::latest:
      return "latest";
    default:
      return "latest-xact";
  }
}

Stores make_stores(const Forest& forest, const StoreOptions& options,
                   const std::vector<std::string>& names) {
  const auto wanted = [&](const std::string& name) {
    return names.empty() || std::find(names.begin(), names.end(), name) != names.end();
  };
  Stores stores;
  for (const char* concurrency : {"optimistic", "2pl", "giant"})
    if (wanted(concurrency)) stores.push_back(make_tree_store(concurrency, forest, options));
  if (wanted("tf2"))
    if (auto tf2 = make_tf2_store(forest, options)) stores.push_back(std::move(tf2));
  return stores;
}

Stamp fill(const Stores& stores, const Forest& forest, unsigned times) {
  constexpr Stamp kStep = 1000;
  constexpr FrameIndex kLongest = 256;
  const auto follows = [&](FrameIndex link) {
    return link < forest.size() && link > 0 && forest.parents[link] == link - 1;
  };
  const auto set_once = [&](Store& store, Stamp stamp) {
    for (FrameIndex link = 0; link < forest.size();) {
      FrameIndex end = link;
      while (follows(end) && end - link < kLongest) ++end;
      if (end > link)
        store.write(0, link - 1, end - link, stamp);
      else if (forest.parents[link] != link)
        store.set(link, stamp);
      link = std::max(end, link + 1);
    }
  };
  std::vector<std::future<void>> filled;  // each store by a thread: it takes long
  for (const auto& store : stores)
    filled.push_back(std::async(std::launch::async, [&] {
      for (unsigned k = 1; k <= times; ++k) set_once(*store, kStart + kStep * k);
    }));
  for (auto& one : filled) one.get();
  return kStart + kStep * times;
}

void check_answers(const Stores& stores, const std::vector<Pair>& pairs) {
  for (const Read kind : {Read::common, Read::latest, Read::latest_xact})
    for (const Pair& pair : pairs) {
      const Store* first = nullptr;
      Reply expected;
      for (auto store = stores.rbegin(); store != stores.rend(); ++store) {
        if (!(*store)->can(kind)) continue;
        Reply reply;
        if (!(*store)->ask(kind, pair.target, pair.source, reply))
          throw std::runtime_error((*store)->name() + ": no answer");
        if (!first) {
          first = store->get();
          expected = reply;
        }
        compare(reply, expected, (*store)->name() + " and " + first->name());
      }
    }
}

}  // namespace bench

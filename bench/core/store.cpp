#include "store.hpp"

#include <stdexcept>

#include "measure.hpp"

namespace bench {

Stores make_stores(const Forest& forest, const StoreOptions& options) {
  Stores stores;
  for (const char* concurrency : {"optimistic", "2pl", "giant"})
    stores.push_back(make_tree_store(concurrency, forest, options));
  if (auto tf2 = make_tf2_store(forest, options)) stores.push_back(std::move(tf2));
  return stores;
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

// In place of tf2_side.cpp and tf2_store.cpp where tf2 is not installed.
#include "side.hpp"
#include "store.hpp"

namespace bench {

std::unique_ptr<Side> make_tf2_side() { return nullptr; }
std::unique_ptr<Store> make_tf2_store(const Forest&, const StoreOptions&) { return nullptr; }

}  // namespace bench

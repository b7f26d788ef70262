// In place of tf2_side.cpp where tf2 is not installed.
#include "side.hpp"

namespace bench {

std::unique_ptr<Side> make_tf2_side() { return nullptr; }

}  // namespace bench

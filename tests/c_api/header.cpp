// The C++ header alone, as C++11.
#include "zenoh_tf/zenoh_tf.hpp"

template class std::vector<zenoh_tf::Answer>;
zenoh_tf::Tree make_tree() { return zenoh_tf::Tree(zenoh_tf::Options()); }
bool can(const zenoh_tf::Tree& tree) { return tree.can("map", std::string("base")); }

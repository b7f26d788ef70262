// Authorities that are freed, so that others can take their places.
#include "fixture.hpp"

using namespace ztf;

namespace {

std::size_t known(const World& w) {
  std::size_t known = 0;
  for (AuthorityId id = 1; id <= w.tree.authorities(); ++id) known += !w.tree.freed(id);
  return known;
}

}  // namespace

TEST(an_authority_that_owns_a_frame_is_not_freed) {
  World w(Options{.max_authorities = 3});
  for (const char* name : {"a", "b", "c"}) w.accept({{"root", name, 1}}, {.authority = name});
  CHECK_EQ(w.refusal({{"root", "d", 1}}, {.authority = "d"}), Code::limit);
  w.tree.remove_frame("b", false);
  w.accept({{"root", "d", 1}}, {.authority = "d"});
  CHECK_EQ(w.refusal({{"root", "e", 1}}, {.authority = "e"}), Code::limit);
  w.tree.clear(true);  // an authority of no sample owns nothing
  w.accept({{"root", "e", 1}}, {.authority = "e"});
}

TEST(the_least_recently_used_are_freed_first) {
  World w(Options{.max_authorities = 4});
  for (Stamp t = 1; const char* name : {"a", "b", "c", "d", "a", "b"})
    w.accept({{"root", "x", ++t}}, {.authority = name});
  // b owns x, and a was used after c and d.
  w.accept({{"root", "y", 1}}, {.authority = "e"});
  std::vector<std::string> left;
  for (AuthorityId id = 1; id <= w.tree.authorities(); ++id)
    if (!w.tree.freed(id)) left.push_back(w.tree.authority(id));
  CHECK(std::find(left.begin(), left.end(), "b") != left.end());
  CHECK(std::find(left.begin(), left.end(), "e") != left.end());
  CHECK_EQ(known(w), 3u);
}

TEST(a_new_authority_begins_with_no_counts) {
  World w(Options{.max_authorities = 2});
  for (Stamp t = 1; t <= 5; ++t) w.accept({{"root", "x", t}}, {.authority = "a"});
  w.accept({{"root", "x", 6}}, {.authority = "b"});
  w.accept({{"root", "y", 1}}, {.authority = "c"});
  for (AuthorityId id = 1; id <= w.tree.authorities(); ++id)
    if (!w.tree.freed(id)) CHECK_EQ(w.tree.authority_counts(id).commits, 1u);
  // Nothing names the one that was freed.
  CHECK_EQ(w.events("x").change_authority.load(), w.info("x").authority);
}

TEST(a_replaced_value_is_not_of_an_authority_that_was_freed) {
  World w(Options{.max_authorities = 2});
  const SetOptions by_a{.authority = "a", .is_static = true};
  const SetOptions by_b{.authority = "b", .is_static = true};
  w.accept({{"root", "x", 0, at_x(1)}}, by_a);
  w.accept({{"root", "x", 0, at_x(3)}}, by_b);
  const FrameEvents& events = w.events("x");
  CHECK_EQ(w.tree.authority(events.replaced_authority.load()), "a");
  CHECK_EQ(events.replaced_m.load(), 2.0F);
  w.accept({{"root", "y", 1}}, {.authority = "c"});
  CHECK_EQ(events.replaced_authority.load(), 0u);
}

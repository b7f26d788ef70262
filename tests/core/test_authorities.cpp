// Authorities that are forgotten, so that others can take their places.
#include "fixture.hpp"

using namespace ztf;

namespace {

std::string nth(const std::string& prefix, int n) { return prefix + std::to_string(n); }

std::size_t known(const World& w) {
  std::size_t known = 0;
  for (AuthorityId id = 1; id <= w.tree.authorities(); ++id) known += !w.tree.forgotten(id);
  return known;
}

}  // namespace

TEST(authorities_come_and_go_for_ever) {
  for_each_concurrency([](Concurrency c) {
    World w(Options{.concurrency = c, .max_authorities = 8});
    CHECK_EQ(w.refusal({{"root", "kept", 1}}, {.authority = "owner"}), Code::ok);
    for (int i = 0; i < 1000; ++i) {
      CHECK_EQ(w.refusal({{"root", "shared", i + 1}}, {.authority = nth("a", i)}), Code::ok);
      CHECK_EQ(w.tree.authority(w.tree.info(w.id("shared")).authority), nth("a", i));
      CHECK_EQ(w.tree.authority(w.tree.info(w.id("kept")).authority), "owner");
      CHECK(known(w) <= 8);
    }
    CHECK_EQ(w.refusal({{"root", "kept", 2}}, {.authority = "owner"}), Code::ok);
    CHECK_EQ(w.tree.events(w.id("kept")).authority_changes.load(), 0u);
  });
}

TEST(an_authority_that_owns_a_frame_is_not_forgotten) {
  World w(Options{.max_authorities = 3});
  for (const char* name : {"a", "b", "c"})
    CHECK_EQ(w.refusal({{"root", name, 1}}, {.authority = name}), Code::ok);
  CHECK_EQ(w.refusal({{"root", "d", 1}}, {.authority = "d"}), Code::limit);
  w.tree.remove_frame("b", false);
  CHECK_EQ(w.refusal({{"root", "d", 1}}, {.authority = "d"}), Code::ok);
  CHECK_EQ(w.refusal({{"root", "e", 1}}, {.authority = "e"}), Code::limit);
  w.tree.clear(true);  // an authority of no sample owns nothing
  CHECK_EQ(w.refusal({{"root", "e", 1}}, {.authority = "e"}), Code::ok);
}

TEST(the_least_recently_used_are_forgotten_first) {
  World w(Options{.max_authorities = 4});
  for (Stamp t = 1; const char* name : {"a", "b", "c", "d", "a", "b"})
    CHECK_EQ(w.refusal({{"root", "x", ++t}}, {.authority = name}), Code::ok);
  // b owns x, and a was used after c and d.
  CHECK_EQ(w.refusal({{"root", "y", 1}}, {.authority = "e"}), Code::ok);
  std::vector<std::string> left;
  for (AuthorityId id = 1; id <= w.tree.authorities(); ++id)
    if (!w.tree.forgotten(id)) left.push_back(w.tree.authority(id));
  CHECK(std::find(left.begin(), left.end(), "b") != left.end());
  CHECK(std::find(left.begin(), left.end(), "e") != left.end());
  CHECK_EQ(known(w), 3u);
}

TEST(a_new_authority_begins_with_no_counts) {
  World w(Options{.max_authorities = 2});
  for (Stamp t = 1; t <= 5; ++t)
    CHECK_EQ(w.refusal({{"root", "x", t}}, {.authority = "a"}), Code::ok);
  CHECK_EQ(w.refusal({{"root", "x", 6}}, {.authority = "b"}), Code::ok);
  CHECK_EQ(w.refusal({{"root", "y", 1}}, {.authority = "c"}), Code::ok);
  for (AuthorityId id = 1; id <= w.tree.authorities(); ++id)
    if (!w.tree.forgotten(id)) CHECK_EQ(w.tree.authority_counts(id).commits, 1u);
  // Nothing names the one that was forgotten.
  CHECK_EQ(w.tree.events(w.id("x")).change_authority.load(), w.tree.info(w.id("x")).authority);
}

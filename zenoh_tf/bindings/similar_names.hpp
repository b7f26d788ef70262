// Which of the names that exist was probably meant by one that does not.
//
// Thread safety: functions of their arguments; did_you_mean(tree, ...) requires the GIL.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "bindings/bindings.hpp"

namespace ztf {

// How many of a tree's names an error compares. That takes about 0.1 ms, and everybody may ask for
// a frame that does not exist.
inline constexpr std::size_t kMostCompared = 1000;
// Among so many ids: those of removed frames are passed over.
inline constexpr FrameId kMostVisited = 16'000;

// At most `most` of the names that are most like one that does not exist, best first: those that
// differ in case or slashes, then by a prefix, as robot1/base_link does from base_link, then by
// some letters.
std::vector<std::string> similar_names(std::string_view name, std::vector<std::string> names,
                                       std::size_t most);

// A question such as "did you mean 'base_link'?"; empty if no name is like one of the unknown ones.
// Of several, the question says which it is about: "did you mean 'base_link' instead of 'base', and
// 'laser' instead of 'lase'?"
std::string did_you_mean(const std::vector<std::string>& unknown,
                         const std::vector<std::string>& names);

// The same of those of the names that are no frame of the tree, to be appended to an error.
template <class AnyTree>
std::string did_you_mean(const AnyTree& tree, std::initializer_list<std::string_view> asked) {
  std::vector<std::string> unknown, names;
  for (const std::string_view name : asked)
    if (tree.find(name) == 0 && std::ranges::find(unknown, name) == unknown.end())
      unknown.emplace_back(name);
  const FrameId last = std::min(tree.size(), kMostVisited);
  for (FrameId id = 1; id <= last && names.size() < kMostCompared; ++id)
    if (!tree.removed(id)) names.push_back(tree.name(id));
  const std::string question = did_you_mean(unknown, names);
  return question.empty() ? "" : "; " + question;
}

void bind_similar_names(nb::module_& m);

}  // namespace ztf

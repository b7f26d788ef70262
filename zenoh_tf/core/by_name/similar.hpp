// Which of the names that exist was probably meant by one that does not.
//
// Thread safety: functions of their arguments.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace ztf {

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

}  // namespace ztf

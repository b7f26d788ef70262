#include "by_name/similar.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <tuple>

#include "base/rejected.hpp"

namespace ztf {

namespace {

constexpr std::size_t kMostBytes = 64;  // of a name that are compared: the bits of a word

// Two names are alike if they share this part of their letters, in the same order.
constexpr double kLeastAlike = 0.6;

// A name without what people confuse: case and slashes.
std::string spelling(std::string_view name) {
  std::string text;
  for (const char c : name)
    if (c != '/') text.push_back(c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c);
  return text;
}

std::string_view last_part(std::string_view name) {
  while (name.ends_with('/')) name.remove_suffix(1);
  return name.substr(name.rfind('/') + 1);  // npos + 1 is 0
}

// How many letters a text has in common with others, in the same order (the longest common
// subsequence): a bit of the word stands for a letter of the text (Hyyrö 2004).
class CommonLetters {
 public:
  explicit CommonLetters(std::string_view text) : text_(text.substr(0, kMostBytes)) {
    for (std::size_t i = 0; i < text_.size(); ++i) places_[byte(text_[i])] |= std::uint64_t{1} << i;
  }
  // The part of both texts' letters that they share, 0 to 1.
  [[nodiscard]] double part(std::string_view other) const {
    other = other.substr(0, kMostBytes);
    std::uint64_t left = ~std::uint64_t{0};
    for (const char c : other) {
      const std::uint64_t matches = left & places_[byte(c)];
      left = (left + matches) | (left - matches);
    }
    const std::size_t n = text_.size();
    const std::uint64_t used = n == kMostBytes ? ~left : ~left & ((std::uint64_t{1} << n) - 1);
    const std::size_t letters = n + other.size();
    return letters == 0 ? 0 : 2.0 * std::popcount(used) / static_cast<double>(letters);
  }

 private:
  static std::size_t byte(char c) noexcept { return static_cast<unsigned char>(c); }

  std::string_view text_;
  std::array<std::uint64_t, 256> places_{};
};

}  // namespace

std::vector<std::string> similar_names(std::string_view name, std::vector<std::string> names,
                                       std::size_t most) {
  const std::string wanted = spelling(name), last = spelling(last_part(name));
  const CommonLetters letters(wanted);
  // Rank, then how unlike it is, then the name.
  std::vector<std::tuple<int, double, std::string>> found;
  for (std::string& other : names) {
    if (other == name) continue;
    const std::string spelt = spelling(other);
    const std::string_view end = last_part(other);
    if (spelt == wanted) {
      found.emplace_back(0, 0.0, std::move(other));
    } else if (!last.empty() && spelling(end) == last) {
      found.emplace_back(1, end == last_part(name) ? 0.0 : 1.0, std::move(other));
    } else if (const double part = letters.part(spelt); part >= kLeastAlike) {
      found.emplace_back(2, 1.0 - part, std::move(other));
    }
  }
  std::ranges::sort(found);
  std::vector<std::string> out;
  for (auto& each : found) {
    if (out.size() == most) break;
    if (out.empty() || out.back() != std::get<2>(each)) out.push_back(std::move(std::get<2>(each)));
  }
  return out;
}

std::string did_you_mean(const std::vector<std::string>& unknown,
                         const std::vector<std::string>& names) {
  std::string question;
  for (const std::string& name : unknown) {
    const std::vector<std::string> found = similar_names(name, names, 3);
    if (found.empty()) continue;
    question += question.empty() ? "did you mean " : ", and ";
    for (std::size_t i = 0; i < found.size(); ++i)
      question += (i == 0 ? "" : i + 1 < found.size() ? ", " : " or ") + quoted(found[i]);
    if (unknown.size() > 1) question += " instead of " + quoted(name);
  }
  return question.empty() ? question : question + "?";
}

}  // namespace ztf

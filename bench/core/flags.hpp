// A part's flags: --name value, nothing else.
//
// Thread safety: values.
#pragma once

#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace bench {

class Flags {
 public:
  // Throws std::invalid_argument where one has no value. All must be asked for before done().
  Flags(int count, char** values) {
    for (int i = 0; i < count; i += 2) {
      if (i + 1 == count) throw std::invalid_argument(std::string("no value for ") + values[i]);
      given_[values[i]] = values[i + 1];
    }
  }

  std::string text(const std::string& name, const std::string& otherwise) {
    const auto found = given_.find(name);
    if (found == given_.end()) return otherwise;
    const std::string value = found->second;
    given_.erase(found);
    return value;
  }

  double number(const std::string& name, double otherwise) {
    const std::string value = text(name, "");
    return value.empty() ? otherwise : std::stod(value);
  }

  template <class T>
  std::vector<T> list(const std::string& name, const std::string& otherwise) {
    std::vector<T> result;
    std::istringstream items(text(name, otherwise));
    for (std::string item; std::getline(items, item, ',');) {
      std::istringstream one(item);
      T value{};
      if (!(one >> value) || !one.eof()) throw std::invalid_argument(name + ": " + item);
      result.push_back(value);
    }
    return result;
  }

  void done() const {
    if (!given_.empty()) throw std::invalid_argument("no such flag: " + given_.begin()->first);
  }

 private:
  std::map<std::string, std::string> given_;
};

}  // namespace bench

// Results for programs: objects and lists as they come, one row of figures to a line.
//
// Thread safety: none.
#pragma once

#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace bench {

class Json {
 public:
  Json& open(const char* key = nullptr, char interval = '{') {
    begin(key);
    text_ += interval;
    closing_ += interval == '{' ? '}' : ']';
    first_ = true;
    return *this;
  }
  Json& close() {
    text_ += closing_.back();
    closing_.pop_back();
    first_ = false;
    return *this;
  }
  Json& line() {
    line_ = true;
    return *this;
  }

  Json& add(const char* key, const std::string& value) {
    begin(key);
    text_.append(1, '"').append(value).append(1, '"');  // names and versions: nothing to escape
    return *this;
  }
  Json& add(const char* key, double value) {
    begin(key);
    number(value);
    return *this;
  }
  Json& add(const char* key, const std::vector<double>& values) {
    open(key, '[');
    for (const double value : values) add(nullptr, value);
    return close();
  }

  void write(const std::string& path) const {
    std::ofstream out(path);
    out << text_ << "\n";
    out.close();
    if (!out) throw std::runtime_error("cannot write " + path);
  }

 private:
  void begin(const char* key) {
    if (!first_) text_ += ", ";
    if (line_) text_.append(1, '\n').append(closing_.size(), ' ');
    if (key) text_.append(1, '"').append(key).append("\": ");
    first_ = line_ = false;
  }
  // What was not measured is not a number, and JSON has none such.
  void number(double value) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.7g", value);
    text_ += std::isfinite(value) ? digits : "null";
  }

  std::string text_, closing_;
  bool first_ = true, line_ = false;
};

}  // namespace bench

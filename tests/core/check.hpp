// A minimal test framework. TEST registers a test; CHECK records a failure and continues.
//
// Thread safety: CHECK from any thread; tests run one after the other.
#pragma once

#include <cmath>
#include <sstream>
#include <string>
#include <type_traits>

namespace check {

using Body = void (*)();

struct Registered {
  Registered(const char* name, Body body);
};

void fail(const char* file, int line, const std::string& what);

template <class T>
std::string shown(const T& value) {
  std::ostringstream text;
  text.precision(17);
  if constexpr (std::is_enum_v<T>)
    text << static_cast<long long>(value);
  else if constexpr (sizeof(T) == 1 && std::is_integral_v<T>)
    text << static_cast<int>(value);
  else
    text << value;
  return text.str();
}

template <class A, class B>
void equal(const char* file, int line, const char* what, const A& a, const B& b) {
  if (!(a == b)) fail(file, line, std::string(what) + ": " + shown(a) + " != " + shown(b));
}

// Fails for NaN.
inline void near(const char* file, int line, const char* what, double a, double b, double within) {
  if (!(std::abs(a - b) <= within))
    fail(file, line, std::string(what) + ": " + shown(a) + " is not near " + shown(b));
}

}  // namespace check

#define TEST(name)                                               \
  static void name();                                            \
  static const check::Registered registered_##name(#name, name); \
  static void name()
#define CHECK(condition) ((condition) ? void() : check::fail(__FILE__, __LINE__, #condition))
#define CHECK_EQ(a, b) check::equal(__FILE__, __LINE__, #a " == " #b, a, b)
#define CHECK_NEAR(a, b, within) check::near(__FILE__, __LINE__, #a " ~ " #b, a, b, within)

// The classes of ROS 2's tf2 exceptions, in our words. Humble has no kinds of extrapolation: with
// TF2_OF_HUMBLE there are none here.
#pragma once

#include <stdexcept>

namespace tf2 {

struct TransformException : std::runtime_error {
  using std::runtime_error::runtime_error;
};
struct ConnectivityException : TransformException {
  using TransformException::TransformException;
};
struct LookupException : TransformException {
  using TransformException::TransformException;
};
struct ExtrapolationException : TransformException {
  using TransformException::TransformException;
};
struct InvalidArgumentException : TransformException {
  using TransformException::TransformException;
};
#ifndef TF2_OF_HUMBLE
struct BackwardExtrapolationException : ExtrapolationException {
  using ExtrapolationException::ExtrapolationException;
};
struct ForwardExtrapolationException : ExtrapolationException {
  using ExtrapolationException::ExtrapolationException;
};
struct NoDataForExtrapolationException : ExtrapolationException {
  using ExtrapolationException::ExtrapolationException;
};
#endif

}  // namespace tf2

// The plain C interface that Python calls by ctypes.
#pragma once

#include <cstdint>
#include <new>

#ifdef _WIN32
#define NABLAHOG_API extern "C" __declspec(dllexport)
#else
#define NABLAHOG_API extern "C" __attribute__((visibility("default")))
#endif

namespace nablahog {

// Runs the body of a function of the interface.  Returns 0, or 1 where memory ran out: no exception reaches Python.
template <class Body>
int guarded(Body body) noexcept {
  try {
    body();
  } catch (const std::bad_alloc&) {
    return 1;
  }
  return 0;
}

// Calls `body.template operator()<T>()` with T = double or float.
template <class Body>
void with_real(bool double_precision, Body body) {
  if (double_precision) {
    body.template operator()<double>();
  } else {
    body.template operator()<float>();
  }
}

}  // namespace nablahog

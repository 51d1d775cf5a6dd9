// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace orbbuf {

/// Predicts the bytes of a JPEG at another quality. They fall as a power of the step between two
/// levels of its quantisation tables, which the quality sets. The exponent is a property of the
/// scene; results correct it. Reentrant.
class SizeModel {
 public:
  /// The bytes at `quality`, as a share of those at quality 50. Both 1..100.
  double share(int quality) const;

  /// An image had `bytes` at quality `from`, and has `reduced_bytes` at `to`, which is lower.
  void learn(double bytes, int from, double reduced_bytes, int to);

 private:
  double exponent_ = 0.69;  // of recorded sequences of cameras, `./dev bench sim`
};

}  // namespace orbbuf

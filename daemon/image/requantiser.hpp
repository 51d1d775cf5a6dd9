// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "common/error.hpp"
#include "common/frame.hpp"

namespace orbbuf {

/// Makes an encoded frame smaller: divides the DCT coefficients of its JPEG by larger quantisation
/// steps, and codes them again. Decodes no pixels. Thread-bound; reuses its storage.
class Requantiser {
 public:
  /// Throws std::runtime_error if libjpeg cannot be set up.
  Requantiser();
  ~Requantiser();

  /// `whole` at `quality` (1..100, others are clamped); of a stereo frame, both images. Keeps
  /// subsampling, restart interval and metadata (APPn, COM). A progressive JPEG becomes a
  /// sequential one. No quantisation step becomes smaller than it was. If `whole` is itself
  /// reduced, whole_bytes and whole_crc remain those of the JPEG that was encoded.
  ///
  /// An error for a JPEG that JpegCodec does not read either, and if it would not become smaller.
  /// An error does not affect the next call. Cost: about that of one JPEG encode of the image, and
  /// 2 bytes of memory for each sample.
  Result<EncodedFrame> reduce(const EncodedFrame& whole, int quality);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace orbbuf

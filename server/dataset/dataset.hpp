// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace orbbuf {

/// What a folder in some layout consists of; paths are relative to it.
struct Dataset {
  struct Image {
    std::string from;  ///< in the session's folder
    std::string to;
  };
  struct Text {
    std::string to;
    std::string content;
  };
  std::vector<Image> images;
  std::vector<Text> texts;
  std::vector<std::string> notes;  ///< what the layout cannot say of a session, one line each
};

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace orbbuf {

/// The view is up to so much wider or narrower.
inline constexpr double kSceneZoomDepth = 0.2;

/// Where the camera over the scene is: in widths of the view at zoom 1.
struct ScenePose {
  double x = 0;
  double y = 0;
  double zoom = 1;      ///< how much wider the view is: the distance to the picture
  double roll_rad = 0;  ///< of the view, from x to y
};
/// It pans, turns and zooms smoothly, as SceneSource says.
ScenePose scene_pose_at(double time_s);

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

namespace orbbuf::evaluation {

/// What kind of place, and who drives there.
struct Style {
  double cell_m = 1;        ///< the place is built of cells; ways are three of them wide
  double speed_m_s = 1.1;   ///< between turns
  double height_m = 2.7;    ///< of walls
  double camera_m = 0.9;    ///< above the floor
  double ahead_m = 0.35;    ///< of the axis that the robot turns about
  double turn_s_min = 2.4;  ///< a quarter turn takes that long
  double turn_s_max = 4.4;
  double exposure_s = 0.006;
  double baseline_m = 0.12;  ///< of a stereo camera
  bool has_ceiling = true;
  int leg_min = 5;  ///< cells from corner to corner
  int leg_max = 9;
  double arc_share = 0.34;  ///< of the corners: taken in an arc; the others on the spot
  double arc_slower = 1.6;  ///< than speed_m_s
  double aside_m = 0;       ///< of the camera, to the right of the axis: another pass, the same way
};

/// A robot in a building; a car in a street, where it takes 3 s for a corner.
inline constexpr Style kCorridor{};
inline constexpr Style kStreet{5, 7, 9, 1.65, 1.2, 3.5, 6, 0.004, 0.54, false, 10, 18, 1, 2.7};

/// Where the camera is, in metres; it looks along `heading` (0: along x, counter-clockwise) and
/// never up, down or aslant.
struct CameraPose {
  double x = 0;
  double y = 0;
  double z = 0;
  double heading = 0;  ///< radians
};

struct Cell {
  int x = 0;
  int y = 0;
};

/// A drive along straight legs that never cross. Quarter turns between them are on the spot or
/// along an arc. The way sways a little, as wheels and legs do.
class Route {
 public:
  /// Long enough for duration_s; the same for the same seed.
  Route(const Style& style, std::uint64_t seed, double duration_s);

  /// t_s: from 0 to duration_s.
  CameraPose at(double t_s) const;

  /// The cells' middle line that the drive follows.
  const std::vector<Cell>& cells() const { return cells_; }
  /// Where the line bends.
  const std::vector<Cell>& corners() const { return corners_; }

 private:
  /// Straight on, or with turn != 0 (radians) a quarter circle.
  struct Piece {
    double length_m = 0;
    double turn = 0;
    double slower = 1;

    /// Of straight way that takes as long.
    double paced_m() const { return length_m * slower; }
  };
  /// From standstill to standstill: a drive along pieces or, without any, a turn on the spot.
  struct Phase {
    double begin_s = 0;
    double duration_s = 0;
    CameraPose start;  ///< of the robot's axis
    std::vector<Piece> pieces;
    double paced_m = 0;
    double turn = 0;
  };

  void add_phase(Phase phase);
  CameraPose axis_at(double t_s) const;

  Style style_;
  std::vector<Phase> phases_;
  std::vector<Cell> cells_;
  std::vector<Cell> corners_;
};

}  // namespace orbbuf::evaluation

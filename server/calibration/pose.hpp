// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace orbbuf {

using Vector3 = std::array<double, 3>;
/// Row by row.
using Matrix3 = std::array<double, 9>;

inline constexpr Matrix3 kIdentity{1, 0, 0, 0, 1, 0, 0, 0, 1};

inline Vector3 row(const Matrix3& matrix, std::size_t i) {
  return {matrix[3 * i], matrix[3 * i + 1], matrix[3 * i + 2]};
}
inline double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline Vector3 scaled(const Vector3& a, double factor) {
  return {a[0] * factor, a[1] * factor, a[2] * factor};
}
inline double length(const Vector3& a) { return std::sqrt(dot(a, a)); }
inline Matrix3 transposed(const Matrix3& m) {
  return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]};
}
inline Vector3 operator*(const Matrix3& m, const Vector3& v) {
  return {dot(row(m, 0), v), dot(row(m, 1), v), dot(row(m, 2), v)};
}
inline Matrix3 operator*(const Matrix3& a, const Matrix3& b) {
  const Matrix3 columns = transposed(b);
  Matrix3 product{};
  for (std::size_t i = 0; i < product.size(); ++i) {
    product[i] = dot(row(a, i / 3), row(columns, i % 3));
  }
  return product;
}

/// Takes a point of frame b to frame a: `a_from_b`.
struct Pose {
  Matrix3 rotation = kIdentity;
  Vector3 translation_m{};

  /// Of a rotation; of another matrix it is no inverse.
  Pose inverse() const {
    const Matrix3 back = transposed(rotation);
    return {back, scaled(back * translation_m, -1)};
  }
  friend Pose operator*(const Pose& a, const Pose& b) {
    const Vector3 moved = a.rotation * b.translation_m;
    return {a.rotation * b.rotation,
            {moved[0] + a.translation_m[0], moved[1] + a.translation_m[1],
             moved[2] + a.translation_m[2]}};
  }
};

}  // namespace orbbuf

// Multiple importance sampling of all bidirectional techniques, carried along subpaths.
//
// A path of n vertices can be made by any technique (s, t), s vertices from the light and t = n - s
// from the eye. With p_s the density of technique s, the power heuristic's weight is
// 1 / (1 + sum over r < s of (p_r / p_s)^2 + sum over r > s of (p_r / p_s)^2). Each sum is made of
// ratios along one subpath only, so it is carried in two numbers per vertex and needs no stored
// vertices (van Antwerpen 2011; Georgiev 2012, "Implementing Vertex Connection and Merging",
// section 4).
//
// Areas are measured in squared radii of the scene: the numbers are alike in scenes of any unit.
// Specular events count as found with density one from both sides. Roulette is left out of all
// densities, on both sides, which keeps the weights of a path's techniques a partition of one.
#pragma once

#include "math/vec.h"

namespace metrofarm::transport {

// At the last vertex y of a subpath.
struct PartialMis {
  // Times the squared density by area with which the other side finds y: of the technique that
  // leaves y to the other side.
  Float last = Float(0.F);
  // Times that and the squared density by solid angle with which the other side, arriving at y,
  // finds the vertex before it: of all techniques that leave it even more.
  Float earlier = Float(0.F);

  // The ray has reached a surface: from densities by solid angle to densities by area.
  // distance2: in squared scene radii; 1 for rays that start at infinity.
  void arrive(Float distance2, Float cosine) {
    const Float per_cosine = Float(1.F) / sqr(cosine);
    last = last * sqr(distance2) * per_cosine;
    earlier = earlier * per_cosine;
  }

  // A direction has been chosen. pdf, reverse_pdf: by solid angle, of this choice and of the choice
  // that a path in the other sense would have made here. cosine: of the new direction.
  void scatter(Float pdf, Float reverse_pdf, Float cosine, Mask delta) {
    const Float through = sqr(cosine);
    const Float sum = through / sqr(pdf) * (earlier * sqr(reverse_pdf) + last);
    earlier = select(delta, through * earlier, sum);
    last = select(delta, Float(0.F), Float(1.F) / sqr(pdf));
  }

  // The sum over this subpath's techniques: density by area with which the other side finds the
  // last vertex, reverse_pdf by solid angle with which it goes on to the one before.
  Float sum(Float density, Float reverse_pdf) const {
    return sqr(density) * (last + earlier * sqr(reverse_pdf));
  }
};

}  // namespace metrofarm::transport

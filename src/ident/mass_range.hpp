// How far inertias and moments of a rig may go from what is known of them.
//
// A spring and a weight, or a drag in the air and an inertia that turns with it, can each be many
// times too large and cancel within the angles that a log visits. Data that stay there do not tell;
// what a link weighs does. Friction has no such range: it differs from rig to rig and from day to
// day.
#ifndef MECHKIT_IDENT_MASS_RANGE_HPP
#define MECHKIT_IDENT_MASS_RANGE_HPP

#include "mechkit/model.h"

namespace mk
{

class MassRange
{
  public:
    // Nothing is known.
    MassRange() = default;
    // Where two models nearly agree in one: between them, and a quarter beyond. One in which they
    // are apart may be anything.
    MassRange(const mk_model &one, const mk_model &other);
    // A third model agrees, or leaves no range.
    void include(const mk_model &third);

    // How far a base parameter of the model is outside of its range, in standard deviations of the
    // logarithm (0 inside), and the slope of that by the parameter.
    double excess(const mk_model &model, int number, double &slope) const;
    bool holds(const mk_model &model) const;

  private:
    // Of magnitudes; 0: no range.
    double low[MK_MAX_PARAMETERS] = {}, high[MK_MAX_PARAMETERS] = {};
    double sign[MK_MAX_PARAMETERS] = {};
};

} // namespace mk
#endif

// What explain decides by: every threshold once, with its unit, its meaning and where it comes
// from.
//
// Numbers that belong to a method (iterations, steps of differences, sizes of plots) stand beside
// the code that needs them. "Looked at on made-up rigs" means: chosen so that error rates on
// generated cases of an independent simulator are those that docs/explain.md states, on seeds other
// than those counted there; "on measured rigs": on the rigs of docs/explain.md. Changing one
// changes error rates: `make challenge`, `make rich` and `make measured` say how.
#ifndef MECHKIT_EXPLAIN_POLICY_HPP
#define MECHKIT_EXPLAIN_POLICY_HPP

#include <cstddef>

namespace mk::policy
{

// --- log likelihood, after a penalty of half ln(N) a parameter (BIC / 2) ---

// A first cause must gain so much to be named: exp(12) is odds of 160,000, against some 400
// candidates asked and data that are not quite as the model of the noise has it.
constexpr double ACCEPT_FIRST = 12.0;
// A further one: a fit with a cause has more ways to bend. Looked at on made-up rigs.
constexpr double ACCEPT_FURTHER = 20.0;
// Two hypotheses that are nearer than that are told as rivals: odds below 150.
constexpr double INSEPARABLE = 5.0;
// A term of the library must be ahead of the catalogue by so much: the library is large, and names
// nothing.
constexpr double BETTER_THAN_CATALOGUE = 10.0;
// And by this share of its gain where even with it the model is far from its data. Looked at on
// made-up rigs.
constexpr double BETTER_THAN_CATALOGUE_FAR = 0.1;
// Share of ACCEPT_FIRST or ACCEPT_FURTHER that a trial of a few iterations must show already.
constexpr double SHOWN_BY_TRIAL = 0.3;
// A reading: causes that gain less, of a model that says nothing within a shooting interval, leave
// the choice to predictions; one that gains next to nothing is not followed by others either. A
// cause that gains more leads on to others. Looked at on made-up rigs (0.07 and more) and on
// measured ones (0.01 to 0.03, where it is no cause).
constexpr double LIKELIHOOD_SAYS_LITTLE = 0.05, LIKELIHOOD_SAYS_NOTHING = 0.02;
// A reading: a sharper sign of dry friction that gains less explains nothing by itself; and of a
// model that says nothing within a shooting interval. Looked at on rigs with such friction (0.02 to
// 0.5) and on measured ones (0.001 to 0.003, and up to 0.04).
constexpr double SHARPNESS_SAYS = 0.01, SHARPNESS_SAYS_FAR = 0.1;
// A reading, at ten times the process noise: a sharper sign that comes no nearer than this to a law
// of friction does not stand in its place. By factors of two k is found roughly only. Looked at on
// made-up rigs: up to 0.24 where it does; 1.3 and more in most searches where it does not.
constexpr double SHARPNESS_COMES_NEAR = 0.5;

// Standard error of a cause's size or shape, over its value, from which the data leave it open.
constexpr double OPEN_SIZE = 0.5;
// And up to which a law is there beyond doubt: 100 standard errors, 5000 in log likelihood.
constexpr double SURE_SIZE = 0.01;
// Of a law's size: so much of it may hang on a term without a name beside it.
constexpr double SAME_SIZE = 0.5;

// --- process noise of a fit, rad/s per sqrt(s), or of 1 cm where a joint slides ---

// Moves a free run by less than the readings' noise within a second: the model follows its data.
constexpr double IMMATERIAL = 6.0e-4;
// Little is missing: further causes are looked for from close by.
constexpr double NEGLIGIBLE = 3.0e-3;
// A trace that long chaotic motion, or a rig that is balanced for long, leaves of a right model.
constexpr double TRACE = 5.0e-3;
// What is missing may be too rare to show; up to here likelihood counts (a reading speaks for
// itself).
constexpr double FAINT = 1.0e-2;
// Contact may leave so much of a right model, by the instants at which it touches, and at most this
// share of what the refitted model needs.
constexpr double CONTACT_LEAVES = 2.0e-2, CONTACT_SHARE = 0.02;
// From here a refit does not lead to none that is faint; no fraction of a count makes up for it.
constexpr double FAR_FROM_DATA = 0.03;
// A shooting interval of the usual length (0.1 s) says nothing.
constexpr double SAYS_NOTHING = 0.3;
// Times the scatter of the readings: from there the noise of a fit is what the model misses.
constexpr double PASSES_FOR_NOISE = 3.0;

// --- what carries over to data that were left out ---

// Standard errors, of one model asked; sqrt(SURE^2 + 2 ln n) of n.
constexpr double SURE = 2.0;
// Share of the gap between refitted model and noise that a cause must close, or of what the others
// leave of it.
constexpr double LEAST_SHARE = 0.05, LEAST_OF_REST = 0.1;
// Part of these that a cause must close to be tried together with others, which are asked for it
// once more at the end: small causes show beside each other.
constexpr double PART_TO_GO_ON = 0.5;
// Times the noise: beyond it a small part of a rest that nobody understands is no finding. Looked
// at on measured rigs.
constexpr double NEAR_THE_NOISE = 100.0;
// Log likelihood of independent errors: at least, and beyond any doubt.
constexpr double LEAST_GAIN = 5.0, NO_DOUBT = 50.0;
// Log likelihood that one cause must gain in another's place; what differs by less is as likely.
constexpr double BETTER_IN_PLACE = 3.0;
// Mean log ratio from which a fold counts as worse: 2 % more squared error.
constexpr double WORSE_FOLD = 0.02;
// Of the usual squared error of a window: so little says next to nothing.
constexpr double NEXT_TO_NOTHING = 0.1;
// Times the noise of the readings: nothing is missing there.
constexpr double AT_NOISE = 2.0;
// Times the noise: so far off, of long logs no single law explains all where several together leave
// that.
constexpr double FAR_FROM_NOISE = 5.0;
// Share of the gap, on data left out, from which what predictions of long logs have found is kept.
constexpr double CLOSED_BY_PREDICTIONS = 0.5;
// Of the refitted model's squared error on held-out data: a cause that has to be in all logs shows.
constexpr double SHOWS = 0.1;

// --- the gain on held-out data, nrmse in units of the motion ---

// Of the squared error, at least, where much is left without a name.
constexpr double LEAST_GAIN_OF_PART = 0.05;
// An extension misleads where there is a gap (in squares of the noise, beyond NOISE_SQUARES of it)
// and it widens by that share.
constexpr double A_GAP = 0.2, WIDER = 0.1, NOISE_SQUARES = 2.0;
// Named causes are confirmed though the training data are not followed: closed, error over noise,
// and closed beyond what any cause is named for.
constexpr double CONFIRMED = 0.9, AS_READ = 1.5, ALL_BUT = 0.99;
// From this factor on a mass is further off than anybody weighs one.
constexpr double NOBODY_WEIGHS_SO = 3.0;
// A rest that has no name is called small where what has one closes this share of the gap.
constexpr double LEAVES_LITTLE = 0.9;
// Times the noise at which a refitted model is right, and where a TRACE of process noise is left.
constexpr double RIGHT = 3.0, RIGHT_WITH_TRACE = 6.0;
// In squares: given values that are so far behind the refitted ones predict nothing.
constexpr double PREDICTS_NOTHING = 100.0;
// Error over the readings' noise, and over the training data's, from which held-out data are
// missed.
constexpr double FAR_FROM_READ = 10.0, FAR_FROM_TRAINED = 3.0;
// Largest command held out over the largest one to learn from, beyond which data show more.
constexpr double BEYOND = 1.2;
// In squares: the refitted model is that far behind the given one and the noise, so the logs are
// hardly of one rig.
constexpr double REFIT_BEHIND = 4.0, REFIT_OVER_NOISE = 9.0;

// --- words ---

// One cause in a hundred of those hidden in generated data was something else, however far ahead.
constexpr double LAPSE = 0.01;
// Standard errors by which each of several causes must be there, so that they do not cancel.
constexpr double ESTABLISHED = 4.0;
// Probability by which given values that are right are that far from their estimate.
constexpr double BY_CHANCE = 1e-4;
// Share of the gap from which a suspect is listed.
constexpr double SUSPECT_SHARE = 0.005;
// Level of all tests of what a rest goes with (Bonferroni).
constexpr double TEST_LEVEL = 0.01;
// Odds at which an experiment tells two rivals apart: twenty to one, in log likelihood.
constexpr double TELLING = 3.0;

// --- values per log, missed counts ---

// Least spread over the standard error of a log's value, and over the group's usual spread.
constexpr double SPREAD_SIGNIFICANT = 3.0, SPREAD_NO_SIZE = 5e-3;
// Of the gain of a drive, which nobody sets again to less.
constexpr double SPREAD_OF_A_GAIN = 5e-3;
// Where counters were zeroed: a shift in standard errors that is one, and how far the amplitudes of
// what repeats with the angle may be apart in different logs.
constexpr double PLACE_SIGNIFICANT = 5.0, ALIKE = 2.0;
// So much of a log is asked (s), and what repeats is asked of the next log if it promises this
// share of what promises most. Looked at on made-up rigs and QUBE, DC motor, cart.
constexpr double PLACE_ASKED_S = 6.0, PLACE_NEAR_THE_BEST = 0.5;
// Steps of readings: least size in counts, over their standard error, over the usual significance.
constexpr double STEP_COUNTS = 3.0, STEP_SIGNIFICANT = 7.0, STEP_OUTSTANDING = 2.5;
// How many times better than an impulse a step must explain the readings around it to be surely
// one, and the share of all steps that must. Missed counts of made-up rigs: 3 to 800, of five
// counts to 75; what looked like steps on measured rigs: half of them below 3.1 at most.
constexpr double STEP_DISTINCT = 3.0, STEPS_DISTINCT = 0.8;
// How many there must be: one is of no size that others have, and a rig that is held upright can be
// pushed once as if by a step.
constexpr size_t FEWEST_STEPS = 2;

// --- how much is looked for ---

// s of data to search in, if not said otherwise.
constexpr double MOST_DATA = 30.0;
// Share of the process noise before it that a cause leaves where it leads on to others, and two
// causes of that of the refitted model.
constexpr double NEARER = 0.5;
// Causes looked for from the refitted model, from where most of them were found otherwise or the
// latest leads on, and by predictions.
constexpr size_t MOST_CAUSES = 3, MOST_FURTHER_CAUSES = 8, MOST_PREDICTING = 8;
// Runners-up that are kept of each cause.
constexpr size_t RIVALS = 2;
// In passes over the data (Search::work_done): nothing more is looked for after so many, and
// earlier causes are not looked at again. Most searches end long before.
constexpr double MOST_WORK = 16000.0, MUCH_WORK = 13000.0;

} // namespace mk::policy
#endif

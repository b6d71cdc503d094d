// What effects remember along a log (sim/effect_memory.hpp).
//
// From each place of the way to the next the model runs by itself; there angles and speeds are set
// back to the readings, so that what the model lacks does not carry it away, and the states z of
// effects go on:
//     z_(i+1) = F_i(z_i, p) .
// The parts are run side by side, each from a state that is guessed, zg_i, and the chain is closed
// by Newton's method (multiple shooting):
//     z_(i+1) = F_i(zg_i) + A_i (z_i - zg_i) ,   A_i = dF_i/dz ,
// again from there until nothing changes. A is small where effects forget, and F_i is nearly linear
// over so short a part: it takes two or three rounds. The derivatives by parameters follow the same
// chain,
//     dz_(i+1)/dp = A_i dz_i/dp + dF_i/dp .
#include "sim/effect_memory.hpp"

#include <cmath>

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace mk
{

// A place where the polynomial has too few readings is left out. Rows that are left out break the
// way: from there on readings begin anew. The states of effects are not in the way: remember()
// finds them, for every model anew.
std::shared_ptr<const Way> way_of(const mk_record &record, const mk_model &model,
                                  const std::vector<size_t> &also)
{
    constexpr double APART = 0.04; // s
    auto way = std::make_shared<Way>();
    VectorXd x(mk_model_state_count(&model));
    const auto out = [&record](size_t k) { return record.left_out && record.left_out[k] != 0.0; };
    const auto wanted = [&also](size_t k) {
        return std::binary_search(also.begin(), also.end(), k);
    };
    size_t begin = 0;
    for (size_t row = 0; row < record.rows;) {
        if (out(row)) {
            begin = ++row;
            continue;
        }
        if (mk_record_state_at(&record, &model, 0, record.rows, row, 0, x.data(), nullptr) ==
            MK_OK) {
            way->row.push_back(row);
            way->begin.push_back(begin);
            way->x.push_back(x.head(2 * mk_model_joints(&model)));
        }
        const double t = record.t[row++];
        while (row < record.rows && record.t[row] - t < APART && !out(row) && !wanted(row))
            row++;
    }
    return way;
}

// Not of a model that hides a joint: its readings are of the light side, so that angles and speeds
// of the heavy one cannot be set back to them.
bool remembers(const mk_model &model)
{
    return mk_model_state_count(&model) > 2 * mk_model_joints(&model) &&
           !mk_model_hides_joint(&model);
}

namespace
{

// The chain of one log.
class Chain
{
  public:
    Chain(mk_start_finder &finder, const std::vector<int> &parameters,
          const std::vector<double> &units);
    // One round. By how much it has moved the states, in units of what is usual.
    double refine();

  private:
    mk_start_finder &f;
    const Way &way;
    const std::vector<int> &free;
    const std::vector<double> &unit;
    const long places, ns, measured, own, columns; // columns: start states, then parameters
    MatrixXd rest;                                 // states of effects that know of no past
    std::vector<double> x, x_end, jac_end;         // by place: ns, ns, ns x columns

    // Whether nothing is known of what was before a place.
    bool begins_at(long i) const
    {
        return i == 0 || way.begin[(size_t)i] != way.begin[(size_t)i - 1];
    }
    void run();
    void measure();
    void step_to(long i, const MatrixXd &guess);
};

Chain::Chain(mk_start_finder &finder, const std::vector<int> &parameters,
             const std::vector<double> &units)
    : f(finder), way(*finder.way), free(parameters), unit(units), places((long)way.row.size()),
      ns(mk_model_state_count(finder.model)), measured(2 * mk_model_joints(finder.model)),
      own(ns - measured), columns(ns + (long)parameters.size()), rest(own, places),
      x((size_t)(ns * places)), x_end(x.size()), jac_end((size_t)(ns * columns * places))
{
    VectorXd at(ns);
    for (long i = 0; i < places; i++) {
        const VectorXd &read = way.x[(size_t)i];
        mk_model_initial_state(f.model, &read(0), &read(measured / 2), at.data());
        rest.col(i) = at.tail(own);
    }
    Memory &m = f.memory;
    if (m.z.rows() != own || m.z.cols() != places)
        m.z = rest;
    m.slope = MatrixXd::Zero(own, (long)free.size() * places);
    measure();
}

// Rms of each state about its mean, sqrt(mean z^2 - (mean z)^2), 1e-9 at least.
void Chain::measure()
{
    const MatrixXd &z = f.memory.z;
    const VectorXd mean = z.rowwise().mean();
    f.memory.usual = (z.colwise() - mean).rowwise().squaredNorm() / (double)places;
    f.memory.usual = f.memory.usual.cwiseMax(1e-18).cwiseSqrt();
}

// F_i, A_i and dF_i/dp of all parts; x_end is not a number where one could not be run.
void Chain::run()
{
    std::vector<ShootTask> tasks;
    std::vector<size_t> of;
    for (long i = 0; i + 1 < places; i++) {
        if (begins_at(i + 1))
            continue;
        const size_t k = (size_t)i;
        double *from = x.data() + k * (size_t)ns;
        Eigen::Map<VectorXd>(from, ns) << way.x[k], f.memory.z.col(i);
        ShootTask task = task_of(f, from, way.row[k], f.t[way.row[k + 1]]);
        task.first_row = task.end_row = 1; // no readings
        task.columns = (int)columns;
        task.close = true; // a round leaves more than these derivatives are off by
        task.free_count = (int)free.size();
        task.free = free.data();
        task.scale = unit.data();
        task.x_end = x_end.data() + k * (size_t)ns;
        task.jac_end = jac_end.data() + k * (size_t)(ns * columns);
        tasks.push_back(task);
        of.push_back(k);
    }
    shoot(tasks.data(), (int)tasks.size());
    for (size_t t = 0; t < tasks.size(); t++)
        if (!tasks[t].finite)
            x_end[of[t] * (size_t)ns] = (double)NAN;
}

// Place i from the one before it; where the model cannot be run to there, it remembers what it did.
void Chain::step_to(long i, const MatrixXd &guess)
{
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Memory &m = f.memory;
    const long p = (long)free.size(), before = i - 1;
    m.z.col(i) = m.z.col(before);
    m.slope.middleCols(p * i, p) = m.slope.middleCols(p * before, p);
    const Eigen::Map<const VectorXd> end(x_end.data() + ns * before, ns);
    const Eigen::Map<const RowMajor> J(jac_end.data() + ns * columns * before, ns, columns);
    if (!end.allFinite() || !J.allFinite())
        return;
    const auto A = J.block(measured, measured, own, own);
    m.z.col(i) = end.tail(own) + A.lazyProduct(m.z.col(before) - guess.col(before));
    m.slope.middleCols(p * i, p) =
        A.lazyProduct(m.slope.middleCols(p * before, p)).eval() + J.bottomRightCorner(own, p);
}

double Chain::refine()
{
    Memory &m = f.memory;
    const MatrixXd guess = m.z;
    run();
    for (long i = 0; i < places; i++) {
        if (!begins_at(i)) {
            step_to(i, guess);
            continue;
        }
        m.z.col(i) = rest.col(i);
        m.slope.middleCols((long)free.size() * i, (long)free.size()).setZero();
    }
    measure();
    return ((m.z - guess).cwiseAbs().rowwise().maxCoeff().array() / m.usual.array()).maxCoeff();
}

} // namespace

// Newton's method squares the error of a round, so that the last one, which moved the states by
// SAME, leaves them far nearer than that.
void remember(mk_start_finder &f, const std::vector<int> &parameters,
              const std::vector<double> &units)
{
    constexpr int MOST_ROUNDS = 8;
    constexpr double SAME = 0.02; // of what is usual
    if (!f.way || f.way->row.empty()) {
        f.memory = {};
        return;
    }
    Chain chain(f, parameters, units);
    for (int round = 0; round < MOST_ROUNDS && chain.refine() > SAME; round++)
        continue;
}

// From the place before the row a run of the model up to it; where that fails, what was remembered
// there.
// Requires remember() before, and a way with a place. One value for each state of an effect.
VectorXd remembered(const mk_start_finder &f, size_t row, MatrixXd *slope)
{
    const size_t place = f.way->place_before(row);
    const long own = f.memory.z.rows(), p = f.memory.slope.cols() / f.memory.z.cols();
    if (slope)
        *slope = f.memory.slope.middleCols(p * (long)place, p);
    const VectorXd there = f.memory.z.col((long)place);
    VectorXd run(f.way->x[place].size() + own);
    run << f.way->x[place], there;
    const size_t from = f.way->row[place];
    if (from >= row || !WindowFit(f, from, from).carry(run, row))
        return there;
    return run.tail(own);
}

// States of effects by a run of MEMORY seconds where there is no way.
// x has all states of the model and is overwritten. Where the run fails, effects have what
// mk_record_state_at() gives them.
bool first_guess(const mk_start_finder &f, size_t last, size_t row, VectorXd &x)
{
    constexpr double MEMORY = 0.5; // s
    if (mk_record_state_at(f.record, f.model, 0, last, row, 0, x.data(), nullptr) != MK_OK)
        return false;
    const long own = x.size() - 2 * mk_model_joints(f.model);
    if (own > 0 && f.memory.z.cols() > 0) {
        x.tail(own) = remembered(f, row);
    } else if (own > 0) {
        size_t back = row;
        while (back > 0 && f.t[row] - f.t[back - 1] <= MEMORY)
            back--;
        VectorXd run = x;
        if (back < row &&
            mk_record_state_at(f.record, f.model, 0, last, back, 0, run.data(), nullptr) == MK_OK &&
            WindowFit(f, back, back).carry(run, row))
            x.tail(own) = run.tail(own);
    }
    return true;
}

} // namespace mk

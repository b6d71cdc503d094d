// Fit: shooting intervals, shot side by side and compressed to normal equations.
//
// Interval i of a log is integrated from its node, x_i, to the next. The kernel (sim/shoot.hpp)
// gives the weighted residuals r_k of the readings in it, its end F_i(x_i, p) and the derivatives
// of both by (x_i, p). Of the residuals only J'J, J'r and r'r are kept (compress).
//
// Long steps are cheap and a little wrong. A correction of what they change, taken at one point,
// lets the points near it be shot with them (coarsen).
#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/parallel.hpp"
#include "ident/fit_priv.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Step of the passes over the data in which work is counted (FitOptions::max_passes), s.
static constexpr double PASS_STEP = 2.5e-3;

// Sum of the delays of all sensors, s: no reading is older than that.
static double sensor_delay(const mk_model &model)
{
    double longest = 0.0;
    for (int e = 0; e < model.effect_count; e++)
        if (mk_effect(model.effect[e].index)->stages & MK_STAGE_SENSOR_DELAY)
            longest += model.effect[e].value[0];
    return longest;
}

// Weights of a log's readings at a point: w_k / sigma_j, so that the kernel's residuals are r_k.
// The weight w_k, 0 to 1, is the square root of the share of an independent reading that reading k
// is worth (ident/fit_log.hpp); a missing reading has 0.
void Fit::lay_data(const FitPoint &point)
{
    int joints = mk_model_joints(&point.model);
    data.resize(logs.size());
    for (size_t l = 0; l < logs.size(); l++) {
        LogData &d = data[l];
        d.shoot = {};
        if (!point.own.empty())
            d.model = model_of_source(point, logs[l]->source);
        d.shoot.rows = logs[l]->rows();
        d.shoot.start = logs[l]->start;
        d.shoot.t = logs[l]->t.data();
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            d.shoot.u[i] = logs[l]->u[i].data();
        for (int j = 0; j < joints; j++) {
            d.weight[j] = logs[l]->weight[j];
            for (double &w : d.weight[j])
                w /= point.noise[j];
            d.shoot.q[j] = logs[l]->q[j].data();
            d.shoot.w[j] = d.weight[j].data();
        }
    }
}

// Buffers of shooting intervals that are shot together.
struct Fit::Batch {
    std::vector<ShootTask> task;
    std::vector<double> jac, scale;
};

// Rows of the log from the interval's node on that the interval may give readings for. Sensors that
// are late show the state as it was: of a reading at t the model's state is at t - late, so that an
// interval sees rows up to `late` behind its end.
size_t Fit::rows_in_view(const FitPoint &point, const Job &job) const
{
    const auto [l, i] = job;
    const Segment &s = work[l][i];
    const ShootingNodes &nodes = point.nodes[l];
    const double late = sensor_delay(point.model);
    size_t stop = s.last ? logs[l]->rows() : nodes.row[i + 1];
    while (stop < logs[l]->rows() && logs[l]->t[stop] < s.end + late + 1e-6)
        stop++;
    return stop - nodes.row[i];
}

// What the kernel is asked about an interval, with room for its answer in `work`. What intervals of
// one batch share is left out.
ShootTask Fit::task_of(const FitPoint &point, const Job &job, int columns)
{
    const auto [l, i] = job;
    const int ns = mk_model_state_count(&point.model);
    Segment &s = work[l][i];
    const size_t capacity = (rows_in_view(point, job) + 2) * (size_t)mk_model_joints(&point.model);
    s.residual.resize(capacity);
    s.joint.resize(capacity);
    s.x_end.resize(ns);
    // The kernel writes ns rows of `columns` numbers, row-major. Eigen's default is column-major,
    // so that the matrix here is the transpose: jac_end(c, s) = d x_end(s) / d column c.
    // Without columns the kernel writes none, and those of an earlier shooting stay.
    if (columns > 0)
        s.jac_end.resize(columns, ns);
    ShootTask task = {};
    task.model = &model_of(point, l);
    task.data = &data[l].shoot;
    task.begin = s.begin;
    task.end = s.end;
    task.last = s.last;
    task.x = point.nodes[l].x.data() + (long)i * ns;
    task.columns = columns;
    task.x_end = s.x_end.data();
    task.jac_end = s.jac_end.data();
    task.row_capacity = capacity;
    task.residual = s.residual.data();
    task.joint_of = s.joint.data();
    return task;
}

// Tasks of one model go side by side.
static void shoot_by_model(std::vector<ShootTask> &task)
{
    for (size_t done = 0, next = 0; done < task.size(); done = next) {
        while (next < task.size() && task[next].model == task[done].model)
            next++;
        shoot(&task[done], (int)(next - done));
    }
}

// Shooting intervals first .. last - 1 of a list of jobs. Columns of the jacobian: the ns start
// states of the interval, then the free parameters.
void Fit::shoot_some(const FitPoint &point, const std::vector<int> &free, const Job *first,
                     const Job *last, bool derivatives)
{
    static thread_local Batch batch;
    const int ns = mk_model_state_count(&point.model);
    const int columns = derivatives ? ns + (int)free.size() : 0;
    const double own = point.step > 0.0 ? point.step : longest_step(point.model);
    batch.scale.clear();
    for (int number : free)
        batch.scale.push_back(scale_of(point.model, number));
    batch.task.clear();
    size_t rows = 0;
    for (const Job *job = first; job < last; job++) {
        ShootTask task = task_of(point, *job, columns);
        task.step = correction ? correction->step : own;
        task.free_count = derivatives ? (int)free.size() : 0;
        task.free = free.data();
        task.scale = batch.scale.data();
        rows += task.row_capacity;
        batch.task.push_back(task);
    }
    batch.jac.resize(rows * (size_t)std::max(columns, 1));
    double *jac = batch.jac.data();
    for (ShootTask &task : batch.task) {
        task.jac = jac;
        jac += task.row_capacity * (size_t)columns;
    }
    shoot_by_model(batch.task);
    for (const Job *job = first; job < last; job++)
        compress(batch.task[(size_t)(job - first)], point.noise, job->first, job->second);
}

// Reduces what shooting gave of an interval to its normal equations. With J_rc = - d r_r / d column
// c and d = (dx_i, dp),
//     1/2 |r - J d|^2 = 1/2 r'r - (J'r)' d + 1/2 d' (J'J) d ,
// so that cost = r'r / 2, right = J'r and normal = J'J are all that the elimination needs. J itself
// is given up: it has as many rows as the interval has readings. Joint by joint, J'J and J'r go
// with 1/sigma_j^2, and are good for every sigma_j.
void Fit::compress(const ShootTask &task, const double *noise, size_t l, size_t i)
{
    Segment &s = work[l][i];
    // Each column of derivatives is counted as a sixth of what a step costs without any.
    s.effort = (double)task.steps * (1.0 + task.columns / 6.0);
    s.finite = task.finite;
    size_t n = task.finite ? task.row_count : 0;
    s.residual.resize(n);
    s.joint.resize(n);
    const Correction *c = correction ? &correction->by_log[l][i] : nullptr;
    // Residuals with steps of length h differ from those with short ones by a nearly constant
    // amount near the point that the correction was taken at:
    //     r(p) = r_h(p) + (r_short - r_h)(p0) ,   F_i likewise.
    // The correction is kept in rad, so that it outlives a change of sigma. States of further
    // effects come after those of that point; they have no correction.
    if (c && n == c->residual.size() && s.x_end.size() >= c->x_end.size()) {
        for (size_t r = 0; r < n; r++)
            s.residual[r] += c->residual[r] / noise[s.joint[r]];
        s.x_end.head(c->x_end.size()) += c->x_end;
    }
    // r'r of each joint.
    s.sum2[0] = s.sum2[1] = 0.0;
    for (size_t r = 0; r < n; r++) {
        s.sum2[s.joint[r]] += s.residual[r] * s.residual[r];
    }
    s.cost = 0.5 * (s.sum2[0] + s.sum2[1]);
    if (task.columns == 0 || !s.finite)
        return;
    const int joints = mk_model_joints(task.model);
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<const RowMajor> J(task.jac, (long)n, task.columns);
    for (int j = 0; j < joints; j++) {
        s.normal[j].resize(task.columns, task.columns);
        gram({task.jac, (long)n, task.columns, joints > 1 ? s.joint.data() : nullptr, j},
             s.normal[j].data());
        s.right[j].setZero(task.columns);
    }
    for (size_t r = 0; r < n; r++)
        s.right[s.joint[r]] += s.residual[r] * J.row((long)r).transpose();
}

// Interval i of log l, without derivatives. Requires prepare() for this point.
void Fit::shoot_one(const FitPoint &point, size_t l, size_t i)
{
    const Job job = {l, i};
    shoot_some(point, {}, &job, &job + 1, false);
}

// Whether `work` has the derivatives of this point, at this noise or another. What was shot without
// derivatives since then has left them alone.
bool Fit::has_slopes(const FitPoint &point, const std::vector<int> &free) const
{
    if (!slopes || slopes->free != free || slopes->correction != correction)
        return false;
    const FitPoint &at = slopes->point;
    if (std::memcmp(&at.model, &point.model, sizeof at.model) != 0 || at.step != point.step ||
        at.own != point.own)
        return false;
    for (size_t l = 0; l < at.nodes.size(); l++)
        if (at.nodes[l].row != point.nodes[l].row || at.nodes[l].x != point.nodes[l].x)
            return false;
    return true;
}

// Afterwards `work` has residuals and ends of all intervals, and normal equations if asked for. A
// search often comes back to a point: derivatives take most of the time, and are not taken twice.
void Fit::shoot_all(const FitPoint &point, const std::vector<int> &free, bool derivatives)
{
    // Enough to keep all lanes busy, few enough to stay near the processor. What is shot together
    // must not depend on the number of threads.
    constexpr size_t FEW = 16, MANY = 64;
    prepare(point);
    const bool known = derivatives && has_slopes(point, free);
    std::vector<Job> jobs;
    for (size_t l = 0; l < logs.size(); l++)
        for (size_t i = 0; i < work[l].size(); i++)
            jobs.emplace_back(l, i);
    size_t parts = jobs.size() < FEW ? 1 : 2 * ((jobs.size() + 2 * MANY - 1) / (2 * MANY));
    parallel_for(options.threads, parts, [&](size_t part) {
        const Job *all = jobs.data();
        shoot_some(point, free, all + jobs.size() * part / parts,
                   all + jobs.size() * (part + 1) / parts, derivatives && !known);
    });
    if (derivatives && !known)
        slopes = std::make_unique<const Slopes>(Slopes{point, free, correction});
    double effort = 0.0, usual = 0.0;
    for (size_t l = 0; l < logs.size(); l++) {
        usual += logs[l]->duration() / PASS_STEP;
        for (const Segment &s : work[l])
            effort += s.effort;
    }
    // In passes: steps taken, derivatives counted in, over the steps of PASS_STEP that all logs
    // have.
    work_done += effort / usual;
}

// Within one long step a contact may begin and end unseen, since the kernel looks for a change of
// sign from one end of the step to the other. So models with contact take shorter ones.
double Fit::longest_step(const mk_model &model) const
{
    // Longest step of models with switching surfaces, s.
    constexpr double CONTACT = 2.5e-3;
    return mk_model_event_count(&model) > 0 ? std::min(options.step, CONTACT) : options.step;
}

// --- long steps, corrected ---

void Fit::coarsen(const FitPoint &point)
{
    constexpr double READING_CHANGE = 0.02; // of the noise: so much may long steps change a reading
    correction.reset();
    // Finds the longest step h, from `longest` down by factors of SHORTER, whose residuals differ
    // from those of the point's own step by less than READING_CHANGE in the rms:
    //     sqrt(mean_k (r_k(short) - r_k(h))^2) < READING_CHANGE .
    // From then on all shooting takes h and adds the difference. Jacobians are those of h: they
    // only have to be good enough for a step.
    const double longest = longest_step(point.model);
    if (!(point.step > 0.0 && point.step < longest))
        return;
    shoot_all(point, {}, false);
    const std::vector<std::vector<Segment>> fine = work;
    auto all = std::make_shared<Corrections>();
    FitPoint coarse = point;
    for (coarse.step = longest; coarse.step > 1.1 * point.step; coarse.step *= SHORTER) {
        shoot_all(coarse, {}, false);
        if (correct(point, fine, *all) < READING_CHANGE) {
            all->step = coarse.step;
            correction = all;
            return;
        }
    }
}

// What makes residuals and ends of fine shooting intervals of the coarse ones that `work` holds.
// Returns the root mean square of the change of the residuals, in the readings' standard
// deviations.
double Fit::correct(const FitPoint &point, const std::vector<std::vector<Segment>> &fine,
                    Corrections &out) const
{
    double sum = 0.0, count = 1e-300;
    out.by_log.assign(work.size(), {});
    for (size_t l = 0; l < work.size(); l++)
        for (size_t i = 0; i < work[l].size(); i++) {
            const Segment &a = fine[l][i], &b = work[l][i];
            Correction c;
            if (!a.finite || !b.finite || a.residual.size() != b.residual.size())
                return HUGE_VAL;
            c.x_end = a.x_end - b.x_end;
            for (size_t r = 0; r < a.residual.size(); r++) {
                const double change = a.residual[r] - b.residual[r];
                sum += change * change, count += 1.0;
                c.residual.push_back(change * point.noise[a.joint[r]]);
            }
            out.by_log[l].push_back(std::move(c));
        }
    return std::sqrt(sum / count);
}

} // namespace mk

// Normal equations of residuals, with the widest instructions of this machine: part of the kernel
// that has derivatives (sim/shoot_kernel.cc). Eigen, compiled for any machine of its kind, has a
// quarter of the lanes.
#ifndef MECHKIT_SIM_SHOOT_NORMAL_HPP
#define MECHKIT_SIM_SHOOT_NORMAL_HPP

#include "sim/shoot_lanes.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

#if MK_DERIVATIVES && MK_WIDTH > 1

// Rows that are multiplied together, copied side by side first: they stay near the processor.
constexpr int BLOCK = 32;
// Rows of the product that are summed up at once.
constexpr int HIGH = 4;
// Columns, in whole registers, with room behind the last ones for both.
constexpr int PADDED = (GRAM_MAX_COLUMNS + HIGH + 2 * W - 1) / W * W;

// Copies up to BLOCK rows of A that are of the joint, from row `next` on. How many.
inline int gather(const GramTask &task, long &next, double (*block)[PADDED])
{
    const int columns = task.columns;
    int n = 0;
    for (; next < task.rows && n < BLOCK; next++) {
        if (task.joint_of && task.joint_of[next] != task.joint)
            continue;
        const double *row = task.a + next * columns;
        for (int c = 0; c < columns; c++)
            block[n][c] = row[c];
        n++;
    }
    return n;
}

// P(a, c) += sum_i B(i, a) B(i, c) of a block B, for c <= a and some further ones.
inline void add_block(const double (*block)[PADDED], int n, int columns, double (*product)[PADDED])
{
    for (int a = 0; a < columns; a += HIGH)
        for (int c = 0; c < a + HIGH; c += W) {
            Base sum[HIGH];
            for (int k = 0; k < HIGH; k++)
                __builtin_memcpy(&sum[k], &product[a + k][c], sizeof sum[k]);
            for (int i = 0; i < n; i++) {
                Base lanes;
                __builtin_memcpy(&lanes, &block[i][c], sizeof lanes);
                for (int k = 0; k < HIGH; k++)
                    sum[k] += Base(block[i][a + k]) * lanes;
            }
            for (int k = 0; k < HIGH; k++)
                __builtin_memcpy(&product[a + k][c], &sum[k], sizeof sum[k]);
        }
}

static void gram(const GramTask &task, double *out)
{
    double block[BLOCK][PADDED], product[PADDED][PADDED];
    // What is multiplied behind the last column counts for nothing, but must be numbers.
    const int used = task.columns + HIGH + W < PADDED ? task.columns + HIGH + W : PADDED;
    for (int i = 0; i < BLOCK; i++)
        for (int c = task.columns; c < used; c++)
            block[i][c] = 0.0;
    for (int a = 0; a < task.columns + HIGH; a++)
        for (int c = 0; c < used; c++)
            product[a][c] = 0.0;
    long next = 0;
    for (int n; (n = gather(task, next, block)) > 0;)
        add_block(block, n, task.columns, product);
    for (int a = 0; a < task.columns; a++)
        for (int c = 0; c < task.columns; c++)
            out[a * task.columns + c] = c <= a ? product[a][c] : product[c][a];
}

#endif

} // namespace MK_KERNEL_NS
} // namespace mk
#endif

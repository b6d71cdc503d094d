#include "base/spectrum.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

void mk_fft(double *re, double *im, size_t n)
{
    for (size_t i = 1, j = 0; i < n; i++) {
        size_t bit = n >> 1;
        for (; j & bit; bit >>= 1)
            j ^= bit;
        j ^= bit;
        if (i < j) {
            double r = re[i], m = im[i];
            re[i] = re[j], im[i] = im[j];
            re[j] = r, im[j] = m;
        }
    }
    for (size_t length = 2; length <= n; length <<= 1) {
        for (size_t k = 0; k < length / 2; k++) {
            double angle = -2.0 * M_PI * (double)k / (double)length;
            double c = cos(angle), s = sin(angle);
            for (size_t a = k; a < n; a += length) {
                size_t b = a + length / 2;
                double r = c * re[b] - s * im[b], m = c * im[b] + s * re[b];
                re[b] = re[a] - r, im[b] = im[a] - m;
                re[a] += r, im[a] += m;
            }
        }
    }
}

/* Sums over the segments, and what a segment is looked at through. */
struct welch {
    size_t n; /* length of a segment */
    double *window, *re, *im;
    double *xx, *yy, *xy_re, *xy_im; /* n / 2 each, from frequency 1 on */
};

static double mean(const double *v, size_t n)
{
    double sum = 0.0;
    for (size_t i = 0; i < n; i++)
        sum += v[i];
    return sum / (double)n;
}

/* Two real signals go through one transform, one as its imaginary part. */
static void add_segment(struct welch *w, const double *x, const double *y)
{
    double mean_x = mean(x, w->n), mean_y = mean(y, w->n);
    for (size_t i = 0; i < w->n; i++) {
        w->re[i] = w->window[i] * (x[i] - mean_x);
        w->im[i] = w->window[i] * (y[i] - mean_y);
    }
    mk_fft(w->re, w->im, w->n);
    for (size_t k = 1; k <= w->n / 2; k++) {
        size_t m = w->n - k;
        double xr = 0.5 * (w->re[k] + w->re[m]), xi = 0.5 * (w->im[k] - w->im[m]);
        double yr = 0.5 * (w->im[k] + w->im[m]), yi = 0.5 * (w->re[m] - w->re[k]);
        w->xx[k - 1] += xr * xr + xi * xi;
        w->yy[k - 1] += yr * yr + yi * yi;
        w->xy_re[k - 1] += xr * yr + xi * yi;
        w->xy_im[k - 1] += xr * yi - xi * yr;
    }
}

static void finish(const struct welch *w, double rate, double power, struct mk_spectrum *out)
{
    double scale = 2.0 / (rate * power * (double)out->segments), turn = 0.0;
    for (size_t k = 0; k < out->count; k++) {
        double cross = w->xy_re[k] * w->xy_re[k] + w->xy_im[k] * w->xy_im[k];
        double both = w->xx[k] * w->yy[k], phase = atan2(w->xy_im[k], w->xy_re[k]);
        bool last = k + 1 == out->count;
        out->f[k] = (double)(k + 1) * rate / (double)w->n;
        out->xx[k] = (last ? 0.5 : 1.0) * scale * w->xx[k];
        out->yy[k] = (last ? 0.5 : 1.0) * scale * w->yy[k];
        out->gain[k] = w->xx[k] > 0.0 ? sqrt(cross) / w->xx[k] : (double)NAN;
        out->coherence[k] = both > 0.0 ? cross / both : (double)NAN;
        if (k > 0)
            turn += 2.0 * M_PI * round((out->phase[k - 1] - phase - turn) / (2.0 * M_PI));
        out->phase[k] = phase + turn;
    }
}

static size_t segment_length(size_t rows, size_t wanted)
{
    size_t n = 8;
    if (wanted == 0)
        wanted = rows / 4;
    while (2 * n <= wanted && 2 * n <= rows)
        n *= 2;
    return n;
}

enum mk_status mk_spectrum_welch(const double *x, const double *y, size_t rows, double rate_hz,
                                 size_t segment, struct mk_spectrum *out)
{
    memset(out, 0, sizeof *out);
    if (rows < 16)
        return MK_ERR_RANGE;
    size_t n = segment_length(rows, segment), half = n / 2;
    double *result = calloc(6 * half, sizeof *result),
           *work = calloc(3 * n + 4 * half, sizeof *work);
    if (!result || !work) {
        free(result);
        free(work);
        return MK_ERR_NOMEM;
    }
    struct welch w = {n,
                      work,
                      work + n,
                      work + 2 * n,
                      work + 3 * n,
                      work + 3 * n + half,
                      work + 3 * n + 2 * half,
                      work + 3 * n + 3 * half};
    double power = 0.0;
    for (size_t i = 0; i < n; i++) {
        w.window[i] = 0.5 - 0.5 * cos(2.0 * M_PI * (double)i / (double)n);
        power += w.window[i] * w.window[i];
    }
    *out = (struct mk_spectrum){half,
                                0,
                                result,
                                result + half,
                                result + 2 * half,
                                result + 3 * half,
                                result + 4 * half,
                                result + 5 * half};
    for (size_t first = 0; first + n <= rows; first += half, out->segments++)
        add_segment(&w, x + first, y + first);
    finish(&w, rate_hz, power, out);
    free(work);
    return MK_OK;
}

void mk_spectrum_free(struct mk_spectrum *s)
{
    free(s->f);
    memset(s, 0, sizeof *s);
}

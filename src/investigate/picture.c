#include "investigate/picture.h"

#include <math.h>
#include <stdbool.h>

#define WIDTH 680
#define LEFT 58
#define RIGHT 12
#define TOP 24
#define BOTTOM 34
#define MOST_POINTS 700
#define BAR_LEFT 310
#define BAR_HEIGHT 22

void picture_text(FILE *out, const char *text)
{
    for (; *text; text++)
        switch (*text) {
        case '<':
            fputs("&lt;", out);
            break;
        case '>':
            fputs("&gt;", out);
            break;
        case '&':
            fputs("&amp;", out);
            break;
        case '\'':
            fputs("&#39;", out);
            break;
        case '"':
            fputs("&quot;", out);
            break;
        default:
            fputc(*text, out);
        }
}

/* A round step that divides a span into about five. */
static double round_step(double span)
{
    const double raw = span / 5.0, power = pow(10.0, floor(log10(raw)));
    if (raw <= power)
        return power;
    if (raw <= 2.0 * power)
        return 2.0 * power;
    return raw <= 5.0 * power ? 5.0 * power : 10.0 * power;
}

struct frame {
    double x0, x1, y0, y1;
    int height;
};

static double px(const struct frame *f, double x)
{
    return LEFT + (x - f->x0) / (f->x1 - f->x0) * (WIDTH - LEFT - RIGHT);
}

static double py(const struct frame *f, double y)
{
    return TOP + (f->y1 - y) / (f->y1 - f->y0) * (f->height - TOP - BOTTOM);
}

static bool frame_of(const struct picture_line *line, int count, struct frame *f)
{
    f->x0 = f->y0 = INFINITY;
    f->x1 = f->y1 = -INFINITY;
    for (int i = 0; i < count; i++)
        for (size_t k = 0; k < line[i].count; k++) {
            const double x = line[i].x[k], y = line[i].y[k];
            if (!isfinite(x) || !isfinite(y))
                continue;
            f->x0 = fmin(f->x0, x);
            f->x1 = fmax(f->x1, x);
            f->y0 = fmin(f->y0, y);
            f->y1 = fmax(f->y1, y);
        }
    if (!(f->x1 > f->x0))
        return false;
    double pad = 0.06 * (f->y1 - f->y0);
    pad = pad > 0.0 ? pad : 1.0;
    f->y0 -= pad;
    f->y1 += pad;
    return true;
}

static void axes(FILE *out, const struct frame *f, const char *x_title, const char *y_title)
{
    const double floor_y = f->height - BOTTOM, dx = round_step(f->x1 - f->x0),
                 dy = round_step(f->y1 - f->y0);
    for (double x = ceil(f->x0 / dx) * dx; x <= f->x1 + 1e-9 * dx; x += dx)
        fprintf(out,
                "<line class='grid' x1='%.1f' x2='%.1f' y1='%d' y2='%.1f'/><text x='%.1f' "
                "y='%.1f' text-anchor='middle'>%g</text>",
                px(f, x), px(f, x), TOP, floor_y, px(f, x), floor_y + 14.0,
                fabs(x) < 1e-9 * dx ? 0.0 : x);
    for (double y = ceil(f->y0 / dy) * dy; y <= f->y1; y += dy)
        fprintf(out,
                "<line class='grid' x1='%d' x2='%d' y1='%.1f' y2='%.1f'/><text x='%d' y='%.1f' "
                "text-anchor='end'>%g</text>",
                LEFT, WIDTH - RIGHT, py(f, y), py(f, y), LEFT - 5, py(f, y) + 4.0,
                fabs(y) < 1e-9 * dy ? 0.0 : y);
    fprintf(out, "<text x='%d' y='%d' text-anchor='end'>", WIDTH - RIGHT, f->height - 4);
    picture_text(out, x_title);
    fprintf(out, "</text><text x='%d' y='14'>", LEFT);
    picture_text(out, y_title);
    fputs("</text>", out);
}

static void draw(FILE *out, const struct frame *f, const struct picture_line *line)
{
    const size_t every = line->count / MOST_POINTS + 1;
    bool down = false;
    fprintf(out, "<path class='%s' d='", line->style);
    for (size_t k = 0; k < line->count; k += every) {
        if (!isfinite(line->y[k])) {
            down = false;
            continue;
        }
        fprintf(out, "%c%.1f %.1f", down ? 'L' : 'M', px(f, line->x[k]), py(f, line->y[k]));
        down = true;
    }
    fputs("'/>", out);
}

static void legend(FILE *out, const struct picture_line *line, int count)
{
    int x = WIDTH - RIGHT - 10;
    for (int i = count - 1; i >= 0; i--) {
        if (!line[i].label)
            continue;
        fprintf(out, "<text x='%d' y='14' text-anchor='end'>", x);
        picture_text(out, line[i].label);
        x -= 150;
        fprintf(out, "</text><path class='%s' d='M%d 10h24'/>", line[i].style, x + 10);
        x -= 10;
    }
}

void picture_lines(FILE *out, const struct picture_line *line, int count, const char *x_title,
                   const char *y_title, int height)
{
    struct frame f = {.height = height};
    if (!frame_of(line, count, &f))
        return;
    fprintf(out, "<svg viewBox='0 0 %d %d' role='img'>", WIDTH, height);
    axes(out, &f, x_title, y_title);
    for (int i = 0; i < count; i++)
        draw(out, &f, &line[i]);
    legend(out, line, count);
    fputs("</svg>\n", out);
}

void picture_bars(FILE *out, const struct picture_bar *bar, int count, const char *unit)
{
    double most = 0.0;
    for (int i = 0; i < count; i++)
        most = fmax(most, fmax(isfinite(bar[i].high) ? bar[i].high : 0.0, bar[i].value));
    if (count == 0 || !(most > 0.0))
        return;
    const int room = WIDTH - BAR_LEFT - 90;
    fprintf(out, "<svg viewBox='0 0 %d %d' role='img'>", WIDTH, count * BAR_HEIGHT + 6);
    for (int i = 0; i < count; i++) {
        const double y = 3.0 + i * BAR_HEIGHT, wide = fmax(bar[i].value, 0.0) / most * room;
        fprintf(out, "<text x='%d' y='%.1f' text-anchor='end'>", BAR_LEFT - 8, y + 15.0);
        picture_text(out, bar[i].label);
        fprintf(out, "</text><rect class='%s' x='%d' y='%.1f' width='%.1f' height='%d'/>",
                bar[i].style, BAR_LEFT, y + 3.0, wide, BAR_HEIGHT - 6);
        if (isfinite(bar[i].low) && isfinite(bar[i].high))
            fprintf(out, "<path class='whisker' d='M%.1f %.1fH%.1f'/>",
                    BAR_LEFT + fmax(bar[i].low, 0.0) / most * room, y + BAR_HEIGHT / 2.0,
                    BAR_LEFT + fmax(bar[i].high, 0.0) / most * room);
        fprintf(out, "<text x='%.1f' y='%.1f'>%.3g %s</text>",
                BAR_LEFT + fmax(wide, isfinite(bar[i].high) ? bar[i].high / most * room : 0.0) +
                    6.0,
                y + 15.0, bar[i].value, unit);
    }
    fputs("</svg>\n", out);
}

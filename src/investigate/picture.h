/* Inline SVG for the notebook: lines over time, and bars. Colours come from the page's style. */
#ifndef MECHKIT_INVESTIGATE_PICTURE_H
#define MECHKIT_INVESTIGATE_PICTURE_H

#include <stddef.h>
#include <stdio.h>

struct picture_line {
    const double *x, *y;
    size_t count;
    const char *style; /* class: "a", "b" */
    const char *label; /* NULL: none */
};

/* Lines over one pair of axes; nothing where there is nothing to draw. Labels are text, not HTML.
 */
void picture_lines(FILE *out, const struct picture_line *line, int count, const char *x_title,
                   const char *y_title, int height);

struct picture_bar {
    const char *label;
    double value, low, high; /* low NAN: no interval */
    const char *style;
};

/* Bars to the right from 0. */
void picture_bars(FILE *out, const struct picture_bar *bar, int count, const char *unit);

/* Text with <, >, & and quotes escaped. */
void picture_text(FILE *out, const char *text);

#endif

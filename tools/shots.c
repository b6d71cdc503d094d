/* Pictures of the console, rendered from a real run: types keys into a terminal of its own and
 * writes what the screen shows as SVG, still and moving.
 *
 *     shots BUILD/mechkit docs/img
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "support/pty.h"

#define ROWS 30
#define COLS 100
#define CELL_W 8
#define CELL_H 16
#define PAD 10
#define MAX_FRAMES 400

struct frame {
    double t;
    struct vt_cell cell[ROWS * COLS];
};

struct film {
    struct pty pty;
    int count;
    double t;
    struct frame *frame;
};

/* --- one screen ------------------------------------------------------------------------------ */

static const char *colour(int index, const char *own)
{
    static const char *const table[16] = {
        "#1d1f21", "#e05561", "#7fc06e", "#e0b050", "#2b5b9e", "#c583d6", "#56b6c2", "#e6e6e6",
        "#808890", "#ff7a85", "#9ae08a", "#ffd070", "#7aa7ea", "#e0a8f0", "#86e0ea", "#ffffff"};
    return index < 0 ? own : table[index & 15];
}

static const char *foreground(const struct vt_cell *c)
{
    if (c->reverse)
        return colour(c->bg, "#16181b");
    return c->dim ? "#7d858e" : colour(c->fg, "#d4d8dd");
}

static const char *background(const struct vt_cell *c)
{
    return c->reverse ? colour(c->fg, "#d4d8dd") : colour(c->bg, NULL);
}

static bool same_look(const struct vt_cell *a, const struct vt_cell *b)
{
    const char *x = background(a), *y = background(b);
    return strcmp(foreground(a), foreground(b)) == 0 && a->bold == b->bold &&
           (x == y || (x && y && strcmp(x, y) == 0));
}

/* Lines of a frame as strokes, so that they meet whatever the font: up, right, down, left. */
static unsigned box_arms(uint32_t ch)
{
    static const struct {
        uint32_t ch;
        unsigned arms;
    } rows[] = {{0x2500, 0xa}, {0x2502, 0x5}, {0x250c, 0x6}, {0x2510, 0xc}, {0x2514, 0x3},
                {0x2518, 0x9}, {0x251c, 0x7}, {0x2524, 0xd}, {0x253c, 0xf}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        if (rows[i].ch == ch)
            return rows[i].arms;
    return 0;
}

static void draw_glyph(FILE *out, uint32_t ch, int x, int y)
{
    static const struct {
        unsigned bit;
        int dx, dy;
    } dots[8] = {{0x01, 2, 2}, {0x02, 2, 6}, {0x04, 2, 10}, {0x40, 2, 14},
                 {0x08, 6, 2}, {0x10, 6, 6}, {0x20, 6, 10}, {0x80, 6, 14}};
    static const char *const arm[4] = {"v-8", "h4", "v8", "h-4"};
    unsigned arms = box_arms(ch);
    if (ch >= 0x2800 && ch < 0x2900)
        for (int i = 0; i < 8; i++)
            if (ch & dots[i].bit)
                fprintf(out, "M%d %dh0", x + dots[i].dx, y + dots[i].dy);
    for (int i = 0; i < 4; i++)
        if (arms & 1u << i)
            fprintf(out, "M%d %d%s", x + 4, y + 8, arm[i]);
}

static bool is_drawn(uint32_t ch)
{
    return (ch >= 0x2800 && ch < 0x2900) || box_arms(ch);
}

static void put_text(FILE *out, uint32_t ch)
{
    if (ch == '<' || ch == '>' || ch == '&')
        fprintf(out, "&#%u;", (unsigned)ch);
    else if (ch < 0x80)
        fputc((int)ch, out);
    else
        fprintf(out, "&#x%x;", (unsigned)ch);
}

/* A stretch of cells that look alike. */
static void draw_stretch(FILE *out, const struct vt_cell *cell, int row, int from, int to)
{
    int x = PAD + from * CELL_W, y = PAD + row * CELL_H;
    const char *back = background(&cell[from]);
    bool text = false, drawn = false;
    if (back)
        fprintf(out, "<rect x='%d' y='%d' width='%d' height='%d' fill='%s'/>", x, y,
                (to - from) * CELL_W, CELL_H, back);
    for (int j = from; j < to; j++) {
        drawn = drawn || is_drawn(cell[j].ch);
        text = text || (cell[j].ch != ' ' && cell[j].ch != 0x2588 && !is_drawn(cell[j].ch));
        if (cell[j].ch == 0x2588)
            fprintf(out, "<rect x='%d' y='%d' width='%d' height='%d' fill='%s'/>", PAD + j * CELL_W,
                    y + 3, CELL_W, CELL_H - 6, foreground(&cell[j]));
    }
    if (drawn) {
        fprintf(out, "<path stroke='%s' d='", foreground(&cell[from]));
        for (int j = from; j < to; j++)
            draw_glyph(out, cell[j].ch, PAD + j * CELL_W, y);
        fputs("'/>", out);
    }
    for (int j = from; text && j < to; j++) {
        if (cell[j].ch == ' ' || cell[j].ch == 0x2588 || is_drawn(cell[j].ch))
            continue;
        int end = j, last = j;
        for (; end < to && cell[end].ch != 0x2588 && !is_drawn(cell[end].ch); end++)
            last = cell[end].ch != ' ' ? end : last;
        fprintf(out, "<text x='%d' y='%d' textLength='%d' fill='%s'%s>", PAD + j * CELL_W, y + 12,
                (last - j + 1) * CELL_W, foreground(&cell[from]),
                cell[from].bold ? " font-weight='bold'" : "");
        for (int k = j; k <= last; k++)
            put_text(out, cell[k].ch);
        fputs("</text>", out);
        j = end - 1;
    }
}

static void draw_row(FILE *out, const struct vt_cell *cell, int row)
{
    for (int from = 0, to; from < COLS; from = to) {
        for (to = from + 1; to < COLS && same_look(&cell[from], &cell[to]); to++)
            ;
        draw_stretch(out, cell, row, from, to);
    }
    fputc('\n', out);
}

static FILE *begin_svg(const char *path)
{
    FILE *out = fopen(path, "w");
    int w = COLS * CELL_W + 2 * PAD, h = ROWS * CELL_H + 2 * PAD;
    if (!out) {
        perror(path);
        exit(1);
    }
    fprintf(out,
            "<svg xmlns='http://www.w3.org/2000/svg' width='%d' height='%d' viewBox='0 0 %d %d' "
            "xml:space='preserve'>\n"
            "<style>text{white-space:pre;font:13px 'DejaVu Sans Mono',Menlo,Consolas,monospace}"
            "rect{shape-rendering:crispEdges}path{fill:none;stroke-width:1.7;stroke-linecap:round}<"
            "/style>\n"
            "<rect width='%d' height='%d' rx='8' fill='#16181b'/>\n",
            w, h, w, h, w, h);
    return out;
}

static void write_still(const char *path, const struct frame *f)
{
    FILE *out = begin_svg(path);
    for (int i = 0; i < ROWS; i++)
        draw_row(out, &f->cell[i * COLS], i);
    fputs("</svg>\n", out);
    fclose(out);
}

/* Rows that stay as they are come once, with the time in which they are seen. */
static void write_film(const char *path, const struct film *m)
{
    FILE *out = begin_svg(path);
    double length = m->t + 2.0;
    for (int i = 0; i < ROWS; i++)
        for (int k = 0, end; k < m->count; k = end) {
            const struct vt_cell *row = &m->frame[k].cell[i * COLS];
            for (end = k + 1; end < m->count; end++)
                if (memcmp(row, &m->frame[end].cell[i * COLS], COLS * sizeof *row) != 0)
                    break;
            double t0 = m->frame[k].t / length, t1 = end < m->count ? m->frame[end].t / length : 1;
            bool always = k == 0 && end == m->count;
            fputs(always ? "<g>" : "<g display='none'>", out);
            if (!always)
                fprintf(out,
                        "<animate attributeName='display' calcMode='discrete' dur='%.2fs' "
                        "repeatCount='indefinite' values='none;inline;none' "
                        "keyTimes='0;%.4f;%.4f'/>",
                        length, t0, t1);
            draw_row(out, row, i);
            fputs("</g>\n", out);
        }
    fputs("</svg>\n", out);
    fclose(out);
}

/* --- a session ------------------------------------------------------------------------------- */

static void take(struct film *m)
{
    if (m->count == MAX_FRAMES)
        return;
    struct frame *f = &m->frame[m->count++];
    f->t = m->t;
    memcpy(f->cell, m->pty.vt.cell, sizeof f->cell);
}

/* Lets it go on for so long, with so many pictures a second. */
static void watch(struct film *m, double seconds, double rate)
{
    int n = (int)(seconds * rate + 0.5);
    for (int k = 0; k < (n > 0 ? n : 1); k++) {
        pty_run(&m->pty, 1.0 / rate);
        m->t += 1.0 / rate;
        take(m);
    }
}

static void type(struct film *m, const char *keys)
{
    for (; *keys; keys++) {
        char key[2] = {*keys, '\0'};
        pty_type(&m->pty, key);
        watch(m, 0.25, 4.0);
    }
}

static void until(struct film *m, const char *text)
{
    if (!pty_shows(&m->pty, text, 60.0))
        exit(1);
    watch(m, 0.2, 5.0);
}

int main(int argc, char **argv)
{
    static struct film film;
    char path[600];
    if (argc != 3) {
        fputs("usage: shots MECHKIT FOLDER\n", stderr);
        return 2;
    }
    char folder[] = "/tmp/mechkit-shots-XXXXXX";
    film.frame = calloc(MAX_FRAMES, sizeof *film.frame);
    char *app = realpath(argv[1], NULL);
    if (!film.frame || !app || !mkdtemp(folder)) {
        perror("shots");
        return 1;
    }
    pty_start(&film.pty, ROWS, COLS, folder, "C.UTF-8",
              (const char *const[]){app, "console", "--out", "runs", NULL});
    until(&film, "choose a setup");
    type(&film, "s");
    watch(&film, 1.0, 1.0);
    type(&film, "\r");
    until(&film, "half a second");
    watch(&film, 2.0, 1.0);
    type(&film, "r");
    until(&film, "RUNNING");
    watch(&film, 5.0, 2.0);
    snprintf(path, sizeof path, "%s/console.svg", argv[2]);
    write_still(path, &film.frame[film.count - 1]);
    type(&film, "g+++d");
    watch(&film, 1.5, 2.0);
    type(&film, "\033");
    watch(&film, 1.5, 2.0);
    type(&film, "h");
    until(&film, "after the run");
    watch(&film, 2.0, 1.0);
    type(&film, "m");
    until(&film, "dotted");
    watch(&film, 2.0, 1.0);
    type(&film, "i");
    until(&film, "written to");
    watch(&film, 3.0, 1.0);
    snprintf(path, sizeof path, "%s/console-run.svg", argv[2]);
    write_film(path, &film);
    pty_type(&film.pty, "q");
    int code = pty_exit_code(&film.pty, 10.0);
    pty_end(&film.pty);
    free(film.frame);
    free(app);
    return code;
}

#include "console/screen/tui_term.h"

/* ncursesw's wide characters. */
#define _XOPEN_SOURCE_EXTENDED 1
#include <curses.h>
#include <fcntl.h>
#include <langinfo.h>
#include <locale.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <term.h> /* after curses.h */
#include <termios.h>
#include <unistd.h>
#include <wchar.h>

/* One terminal a process: what curses keeps for itself, and what a crash handler needs. */
static struct {
    bool open, unicode, colours;
    SCREEN *screen;
    struct termios before;
    bool have_before;
    attr_t attr[STYLE_COUNT];
} term;

/* Without colours the same differences by weight; words say what matters in any case. */
static const struct look {
    short fg, bg; /* -1: the terminal's own */
    attr_t with_colours, without;
} looks[STYLE_COUNT] = {
    [STYLE_NORMAL] = {-1, -1, A_NORMAL, A_NORMAL},
    [STYLE_DIM] = {-1, -1, A_DIM, A_DIM},
    [STYLE_TITLE] = {COLOR_CYAN, -1, A_BOLD, A_BOLD},
    [STYLE_BAR] = {COLOR_WHITE, COLOR_BLUE, A_BOLD, A_REVERSE},
    [STYLE_VALUE] = {-1, -1, A_BOLD, A_BOLD},
    [STYLE_GOOD] = {COLOR_GREEN, -1, A_BOLD, A_BOLD},
    [STYLE_WARN] = {COLOR_YELLOW, -1, A_BOLD, A_BOLD | A_UNDERLINE},
    [STYLE_BAD] = {COLOR_WHITE, COLOR_RED, A_BOLD, A_BOLD | A_REVERSE},
    [STYLE_KEY] = {COLOR_YELLOW, -1, A_BOLD, A_BOLD},
    [STYLE_SELECTED] = {COLOR_BLACK, COLOR_CYAN, A_NORMAL, A_REVERSE},
    [STYLE_TRACE_A] = {COLOR_GREEN, -1, A_NORMAL, A_NORMAL},
    [STYLE_TRACE_B] = {COLOR_CYAN, -1, A_NORMAL, A_NORMAL},
    [STYLE_TRACE_C] = {COLOR_YELLOW, -1, A_NORMAL, A_NORMAL},
    [STYLE_TRACE_D] = {COLOR_MAGENTA, -1, A_NORMAL, A_DIM},
};

static void choose_looks(bool mono)
{
    term.colours = !mono && !getenv("NO_COLOR") && has_colors();
    if (term.colours) {
        start_color();
        use_default_colors();
    }
    for (short i = 0; i < STYLE_COUNT; i++) {
        const struct look *l = &looks[i];
        term.attr[i] = term.colours ? l->with_colours : l->without;
        if (term.colours && (l->fg >= 0 || l->bg >= 0)) {
            init_pair((short)(i + 1), l->fg, l->bg);
            term.attr[i] |= (attr_t)COLOR_PAIR(i + 1);
        }
    }
}

static void set_modes(void)
{
    raw(); /* Ctrl-C, Ctrl-Z, Ctrl-\ are keys: the motor is stopped first */
    noecho();
    nonl();
    keypad(stdscr, TRUE);
    meta(stdscr, TRUE);
    set_escdelay(50);
    /* Some terminals send these although they were asked for the others. */
    static const struct {
        const char *bytes;
        int key;
    } also[] = {{"\033[A", KEY_UP},   {"\033[B", KEY_DOWN}, {"\033[C", KEY_RIGHT},
                {"\033[D", KEY_LEFT}, {"\033[H", KEY_HOME}, {"\033[F", KEY_END}};
    for (size_t i = 0; i < sizeof also / sizeof also[0]; i++)
        define_key(also[i].bytes, also[i].key);
    nodelay(stdscr, TRUE);
}

/* Text consoles have fonts of 256 or 512 characters, none of them Braille. */
static bool has_braille(void)
{
    static const char *const without[] = {"linux", "vt", "ansi", "cons25", "dumb"};
    const char *name = getenv("TERM");
    for (size_t i = 0; name && i < sizeof without / sizeof without[0]; i++)
        if (strncmp(name, without[i], strlen(without[i])) == 0)
            return false;
    return true;
}

enum mk_status term_open(const struct term_options *options, struct mk_error *err)
{
    if (!isatty(STDIN_FILENO) || !isatty(STDOUT_FILENO))
        return mk_error_set(err, MK_ERR_NOTSUP,
                            "the console needs a terminal; command files run without one: "
                            "mechkit run FILE");
    setlocale(LC_CTYPE, "");
    term.unicode = !options->ascii && strcmp(nl_langinfo(CODESET), "UTF-8") == 0 && has_braille();
    term.have_before = tcgetattr(STDIN_FILENO, &term.before) == 0;
    const char *name = getenv("TERM");
    int known = 0;
    if (!name || setupterm(name, STDOUT_FILENO, &known) != OK)
        return mk_error_set(err, MK_ERR_NOTSUP,
                            "the terminal '%s' is not known here; try TERM=vt100",
                            name ? name : "");
    bool addressable = cursor_address != NULL;
    del_curterm(cur_term);
    if (!addressable)
        return mk_error_set(err, MK_ERR_NOTSUP,
                            "the terminal '%s' cannot place its cursor; if it can, try TERM=vt100",
                            name);
    term.screen = newterm(NULL, stdout, stdin);
    if (!term.screen)
        return mk_error_set(err, MK_ERR_NOTSUP, "curses cannot use the terminal '%s'", name);
    set_modes();
    choose_looks(options->mono);
    term.open = true;
    return MK_OK;
}

void term_close(void)
{
    if (!term.open)
        return;
    term.open = false;
    endwin();
    delscreen(term.screen);
    term.screen = NULL;
}

void term_restore_in_crash(void)
{
    /* Attributes off, cursor on, main screen: understood by whatever people use. */
    static const char normal[] = "\033[0m\033[?25h\033[?1049l\r\n";
    if (!term.open)
        return;
    /* A terminal that takes nothing more must not hold the end up. */
    int flags = fcntl(STDOUT_FILENO, F_GETFL);
    (void)fcntl(STDOUT_FILENO, F_SETFL, flags | O_NONBLOCK);
    ssize_t written = write(STDOUT_FILENO, normal, sizeof normal - 1);
    (void)written;
    (void)fcntl(STDOUT_FILENO, F_SETFL, flags);
    if (term.have_before)
        tcsetattr(STDIN_FILENO, TCSANOW, &term.before);
}

bool term_unicode(void)
{
    return term.unicode;
}

void term_size(int *rows, int *cols)
{
    struct winsize w;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &w) == 0 && w.ws_row > 0 && w.ws_col > 0 &&
        (w.ws_row != LINES || w.ws_col != COLS))
        resizeterm(w.ws_row, w.ws_col);
    *rows = LINES;
    *cols = COLS;
}

void term_redraw(void)
{
    clearok(curscr, TRUE);
}

void term_show(const struct canvas *c)
{
    for (int i = 0; i < c->rows && i < LINES; i++)
        for (int j = 0; j < c->cols && j < COLS; j++) {
            const struct tui_cell *cell = &c->cell[i * c->cols + j];
            attr_t attr = term.attr[cell->style];
            wchar_t text[2] = {(wchar_t)cell->ch, 0};
            cchar_t out;
            setcchar(&out, text, attr & ~(attr_t)A_COLOR, (short)PAIR_NUMBER(attr), NULL);
            mvadd_wch(i, j, &out);
        }
    if (c->cursor_row >= 0) {
        move(c->cursor_row, c->cursor_col);
        curs_set(1);
    } else {
        curs_set(0);
    }
    refresh();
}

static int translate(wint_t code)
{
    static const struct {
        wint_t curses;
        int key;
    } rows[] = {{KEY_LEFT, TK_LEFT},       {KEY_RIGHT, TK_RIGHT},     {KEY_UP, TK_UP},
                {KEY_DOWN, TK_DOWN},       {KEY_HOME, TK_HOME},       {KEY_END, TK_END},
                {KEY_PPAGE, TK_PAGE_UP},   {KEY_NPAGE, TK_PAGE_DOWN}, {KEY_DC, TK_DELETE},
                {KEY_BACKSPACE, TK_ERASE}, {KEY_ENTER, TK_RETURN},    {KEY_BTAB, TK_BACK_TAB}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        if (rows[i].curses == code)
            return rows[i].key;
    return TK_NONE;
}

static int read_key(void)
{
    wint_t code;
    int kind = get_wch(&code);
    if (kind == ERR)
        return TK_NONE;
    if (kind == KEY_CODE_YES)
        return translate(code);
    if (code == '\n')
        return TK_RETURN;
    return code == 8 ? TK_ERASE : (int)code;
}

int term_key(int timeout_ms)
{
    int key = read_key();
    if (key != TK_NONE)
        return key;
    struct pollfd fd = {.fd = STDIN_FILENO, .events = POLLIN};
    if (poll(&fd, 1, timeout_ms) <= 0)
        return TK_NONE;
    int waiting = 0;
    bool ended = ioctl(STDIN_FILENO, FIONREAD, &waiting) != 0 || waiting == 0;
    if ((fd.revents & (POLLHUP | POLLERR | POLLNVAL)) || ended)
        return TK_GONE;
    return read_key();
}

void term_suspend(void)
{
    endwin();
    raise(SIGSTOP);
    set_modes();
    term_redraw();
    refresh();
}

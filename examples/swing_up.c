/* The library from C: a controller swings a virtual pendubot up and holds it, the run is logged,
 * and the model is held against the log it made.
 *
 *     cc -o swing_up swing_up.c $(pkg-config --cflags --libs mechkit)
 *     ./swing_up /usr/share/mechkit/models/pendubot.ini run.csv
 *
 * For a real rig open the back end "usb" instead of "virtual" and use mk_clock_init_monotonic().
 */
#include <stdio.h>

#include <mechkit/board.h>
#include <mechkit/ctrl.h>
#include <mechkit/loop.h>
#include <mechkit/sim.h>

static const double rate_hz = MK_LOOP_RATE_HZ;

static bool held_for_2_s(const struct mk_loop_snapshot *now, void *user)
{
    (void)user;
    return now->sample.t - now->balanced_since >= 2.0; /* NaN while it does not balance */
}

/* Swings up, holds for 2 s, switches off. The log is complete when this returns. */
static enum mk_status run(struct mk_loop *loop, const char *log_path, struct mk_error *err)
{
    enum mk_status st = mk_loop_start(loop, log_path, NULL, 0, err);
    if (st != MK_OK)
        return st;
    st = mk_loop_wait(loop, 15.0, held_for_2_s, NULL, NULL, err);
    struct mk_loop_snapshot last;
    mk_loop_get_snapshot(loop, &last);
    enum mk_status halted = mk_loop_halt(loop, st == MK_OK ? err : NULL);
    if (st == MK_OK && halted == MK_OK)
        printf("caught after %.2f s, held until %.2f s\n", last.caught_t, last.sample.t);
    return st != MK_OK ? st : halted;
}

/* Board, controller and loop for one run on the virtual rig, in simulated time. */
static enum mk_status swing_up(const struct mk_model *model, const char *log_path,
                               struct mk_error *err)
{
    struct mk_clock clock;
    struct mk_board *board = NULL;
    struct mk_ctrl *ctrl = NULL;
    struct mk_loop *loop = NULL;
    struct mk_loop_config config;
    mk_clock_init_simulated(&clock);
    mk_loop_config_default(model, &config);
    config.rate_hz = rate_hz;
    struct mk_board_config rig = {.model = model, .clock = &clock};

    enum mk_status st = mk_board_open(mk_board_backend_by_name("virtual"), &rig, &board, err);
    if (st == MK_OK)
        st = mk_ctrl_create(mk_ctrl_setup_by_name("pendubot-mid"), model, 1.0 / rate_hz, NULL,
                            &ctrl, err);
    if (st == MK_OK)
        st = mk_loop_create(board, ctrl, &config, &loop, err);
    if (st == MK_OK)
        st = run(loop, log_path, err);
    mk_loop_destroy(loop);
    mk_ctrl_destroy(ctrl);
    mk_board_close(board);
    return st;
}

/* Free runs of a quarter of a second from the log's own states. */
static enum mk_status compare(const struct mk_model *model, const char *log_path,
                              struct mk_error *err)
{
    struct mk_log *log = NULL, *prediction = NULL;
    struct mk_predict_options options = {.window_s = 0.25};
    struct mk_predict_figures figures;
    enum mk_status st = mk_log_read(log_path, &log, err);
    if (st == MK_OK)
        st = mk_predict(model, log, &options, &prediction, &figures, NULL, err);
    if (st == MK_OK)
        printf("model against log: rms %.2g rad and %.2g rad in %zu windows\n", figures.rms[0],
               figures.rms[1], figures.windows);
    mk_log_free(prediction);
    mk_log_free(log);
    return st;
}

int main(int argc, char **argv)
{
    struct mk_model model;
    struct mk_error err = MK_ERROR_INIT;
    if (argc != 3) {
        fprintf(stderr, "usage: %s MODEL.ini LOG.csv\n", argv[0]);
        return 2;
    }
    enum mk_status st = mk_model_read(argv[1], &model, &err);
    if (st == MK_OK)
        st = swing_up(&model, argv[2], &err);
    if (st == MK_OK)
        st = compare(&model, argv[2], &err);
    if (st != MK_OK) {
        char text[1024];
        fprintf(stderr, "%s\n", mk_error_format(&err, text, sizeof text));
    }
    return st == MK_OK ? 0 : 1;
}

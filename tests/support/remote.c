#include "support/remote.h"

#include <check.h>
#include <string.h>

struct remote remote;

void remote_setup(void)
{
    memset(&remote, 0, sizeof remote);
    remote.err = (struct mk_error)MK_ERROR_INIT;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &remote.model);
    mk_clock_init_simulated(&remote.clock);
}

void remote_teardown(void)
{
    remote_close();
    emu_bench_free(&remote.bench);
}

struct mk_board_config remote_config(void)
{
    return (struct mk_board_config){
        .model = &remote.model, .clock = &remote.clock, .device = remote.bench.device};
}

void remote_plug_in(const char *line)
{
    const struct mk_board_config config = {.model = &remote.model, .clock = &remote.clock};
    emu_bench_init(&remote.bench, line, &config);
}

enum mk_status remote_open(void)
{
    const struct mk_board_config config = remote_config();
    return mk_board_open(&remote.bench.ops, &config, &remote.board, &remote.err);
}

enum mk_status remote_try_open(const char *name, const char *device)
{
    struct mk_clock real;
    mk_clock_init_monotonic(&real);
    const struct mk_board_config config = {
        .model = &remote.model, .clock = &real, .device = device};
    return mk_board_open(mk_board_backend_by_name(name), &config, &remote.board, &remote.err);
}

void remote_sit_at(const char *line)
{
    remote_plug_in(line);
    remote_must(remote_open());
}

void remote_close(void)
{
    mk_board_close(remote.board);
    remote.board = NULL;
}

void remote_must(enum mk_status st)
{
    ck_assert_msg(st == MK_OK, "%s: %s", mk_status_name(st), remote.err.message);
}

void remote_says(const char *text)
{
    ck_assert_msg(strstr(remote.err.message, text) != NULL, "no '%s' in: %s", text,
                  remote.err.message);
}

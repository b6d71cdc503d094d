/* What the files of the commands share. */
#ifndef MECHKIT_CONSOLE_SCRIPT_CMD_PRIV_H
#define MECHKIT_CONSOLE_SCRIPT_CMD_PRIV_H

#include "console/script/cmd.h"

/* A finite number; MK_ERR_PARSE says what it was. */
enum mk_status cmd_number(const char *text, double *out, struct mk_error *err);
/* What a rate and a seed may be. */
enum mk_status cmd_rate(const char *text, double *out, struct mk_error *err);
enum mk_status cmd_seed(const char *text, uint64_t *out, struct mk_error *err);
/* "COND within S" or "COND for S": takes the number after the last such word off the text. False:
 * there is none. */
bool cmd_split_seconds(char *text, const char *word, double *seconds);
/* MK_ERR_STATE before the first `setup`. */
enum mk_status cmd_need_setup(const struct session *s, struct mk_error *err);
enum mk_status cmd_no_setup(struct mk_error *err);
/* Arguments of gains and set for a setup: into its values, `value`. */
enum mk_status cmd_read_gains(const struct mk_ctrl_ops *setup, int argc, char **argv, double *value,
                              struct mk_error *err);
enum mk_status cmd_read_set(const struct mk_ctrl_ops *setup, char **argv, double *value,
                            struct mk_error *err);
/* Where a safety limit is kept, by its name. */
enum mk_status cmd_find_limit(struct mk_safety_limits *limits, const char *name, double **at,
                              struct mk_error *err);
/* Whether a limit of that name may be x on the rig `model` (NULL: on any). MK_ERR_RANGE names the
 * range. */
enum mk_status cmd_check_limit_value(const char *name, double x, const struct mk_model *model,
                                     struct mk_error *err);

/* The slots `check` of the commands. */
enum mk_status cmd_check_rate(struct cmd_known *known, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_check_seed(struct cmd_known *known, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_check_seconds(struct cmd_known *known, int argc, char **argv,
                                 struct mk_error *err);
enum mk_status cmd_check_on_off(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err);
enum mk_status cmd_check_expect(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err);
enum mk_status cmd_check_wait_until(struct cmd_known *known, int argc, char **argv,
                                    struct mk_error *err);
enum mk_status cmd_check_faults(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err);
enum mk_status cmd_check_setup(struct cmd_known *known, int argc, char **argv,
                               struct mk_error *err);
enum mk_status cmd_check_gains(struct cmd_known *known, int argc, char **argv,
                               struct mk_error *err);
enum mk_status cmd_check_set(struct cmd_known *known, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_check_limit(struct cmd_known *known, int argc, char **argv,
                               struct mk_error *err);
enum mk_status cmd_check_show(struct cmd_known *known, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_check_start(struct cmd_known *known, int argc, char **argv,
                               struct mk_error *err);
enum mk_status cmd_check_halt(struct cmd_known *known, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_check_writes_model(struct cmd_known *known, int argc, char **argv,
                                      struct mk_error *err);
enum mk_status cmd_check_model(struct cmd_known *known, int argc, char **argv,
                               struct mk_error *err);
enum mk_status cmd_check_believe(struct cmd_known *known, int argc, char **argv,
                                 struct mk_error *err);
enum mk_status cmd_check_swingup(struct cmd_known *known, int argc, char **argv,
                                 struct mk_error *err);
enum mk_status cmd_check_signal(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err);

enum mk_status cmd_do_gains(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_set(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_limit(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_identify(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_explain(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_compare(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_replay(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_record(struct session *s, int argc, char **argv, struct mk_error *err);
/* Around each command while `record` is on: its line, after a pause as long as the run was left
 * alone, is made before it is executed, which cuts conditions to pieces, and written if it
 * succeeds.
 */
void cmd_record_line(struct session *s, const struct cmd_line *line, char *text, size_t size);
void cmd_record(struct session *s, const char *text);

#endif

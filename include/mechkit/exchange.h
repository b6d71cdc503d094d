/* Exchange with other programs: logs to MAT files and to CSV in other units; models to Octave and
 * C.
 *
 * Not RT-safe: allocates, does I/O. Many threads may export at once.
 */
#ifndef MECHKIT_EXCHANGE_H
#define MECHKIT_EXCHANGE_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- tables: columns of a log, chosen and in units of one's own ------------------------------ */

struct mk_table_column {
    char name[64]; /* as in the log */
    char unit[16]; /* "rad", "ms", ...; "" for none */
    bool own_unit; /* other than the log's */
    double *data;  /* `rows` values */
};

struct mk_table {
    size_t rows, count;
    struct mk_table_column *column;
};

/* Picks columns: "t:ms,q1:deg,u:Nm" names them in order, each with the unit it is wanted in (none:
 * the log's). NULL: every column that holds numbers. Units: s ms us; rad deg rev; rad/s deg/s rpm
 * rev/s; Nm mNm for torques and commands, which `u_to_torque` (N m per unit) turns into torques.
 * MK_ERR_USAGE names the column or unit that does not fit. The caller frees: mk_table_free. */
MK_NODISCARD enum mk_status mk_table_from_log(const struct mk_log *log, const char *columns,
                                              double u_to_torque, struct mk_table **out,
                                              struct mk_error *err);
void mk_table_free(struct mk_table *table); /* NULL allowed */

/* N m per unit of command that a log was recorded with: its metadata, else the model's (may be
 * NULL), else 0, unknown; 1 when the log has torques in place of commands. */
double mk_log_u_to_torque(const struct mk_log *log, const struct mk_model *model);

/* Writes a table as CSV, atomically. A unit that is not the log's stands behind the name: q1_deg.
 * `meta` (may be NULL): the log whose metadata goes on top as # lines. `separator` one character;
 * with ';' the decimal point is a comma, as spreadsheets of some languages want it. */
MK_NODISCARD enum mk_status mk_table_write_csv(const char *path, const struct mk_table *table,
                                               const struct mk_log *meta, char separator,
                                               struct mk_error *err);

/* --- MAT files ------------------------------------------------------------------------------ */

enum mk_mat_version {
    MK_MAT_5, /* what every MATLAB since 5 and Octave read */
    MK_MAT_73 /* HDF5 inside: for HDF5 readers and arrays beyond 2 GB */
};

struct mk_mat_run {
    const char *name; /* of the run; usually the log's file name */
    const struct mk_log *log;
    const struct mk_table *table;
    const struct mk_model *model; /* may be NULL */
};

/* Writes runs as one 1 x count struct array `variable` (docs/matlab.md has its fields), atomically.
 * MK_ERR_IO, MK_ERR_PERM, MK_ERR_NOMEM, MK_ERR_NOTSUP (v7.3 in a matio without HDF5). */
MK_NODISCARD enum mk_status mk_mat_write(const char *path, enum mk_mat_version version,
                                         const char *variable, const struct mk_mat_run *runs,
                                         size_t count, struct mk_error *err);

/* --- models --------------------------------------------------------------------------------- */

/* Writes a model in another language. The equations are those of the library itself, evaluated over
 * symbols: effects included. The file's name becomes the function's name, MK_ERR_USAGE when it
 * cannot. Slips of missed-counts are left out, as in every simulation.
 *
 * Octave and MATLAB: one function file. Delays are stated in it; mk_simulate applies them. */
MK_NODISCARD enum mk_status mk_export_octave(const char *path, const struct mk_model *model,
                                             struct mk_error *err);
/* C: `path` and a header beside it, C99 without dependencies, with an integrator; delays and
 * contact included. */
MK_NODISCARD enum mk_status mk_export_c(const char *path, const struct mk_model *model,
                                        struct mk_error *err);
/* FMI 2.0 for co-simulation: an FMU with that C inside, and compiled for this machine by $CC (cc).
 * *compiled is false where there is no compiler: the FMU then has its sources alone. */
MK_NODISCARD enum mk_status mk_export_fmu(const char *path, const struct mk_model *model,
                                          bool *compiled, struct mk_error *err);

#ifdef __cplusplus
}
#endif
#endif

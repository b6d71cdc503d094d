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
#pragma GCC visibility push(default)

/* --- tables: columns of a log, chosen and in units of one's own ------------------------------ */

struct mk_table_column {
    char name[64]; /* as in the log */
    char unit[16]; /* "rad", "ms", ...; "" for none */
    bool own_unit; /* other than the log's */
    double *data;  /* `rows` values */
    int text_line; /* first line of a foreign file with text for a number; 0: none */
    char text[24]; /* that text, as far as it fits */
};

struct mk_table {
    size_t rows, count;
    struct mk_table_column *column;
    char left_out[200]; /* of a foreign file, and why: "q1 (499 values, not 500)" */
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

/* --- import of measured data ------------------------------------------------------------------ */

#define MK_IMPORT_COLUMNS 16

/* One column of a log and where it comes from: sign * (from + plus - minus, in `unit`) + offset. A
 * sum or a difference is what an angle is that was measured from elsewhere: of a link from the
 * vertical instead of from the link before it. */
struct mk_import_column {
    char to[32];    /* column of the log: t, q1, q2, u, tau1, ... or any other name */
    char from[64];  /* column of the file, by name or by number from 1 */
    char plus[64];  /* column that is added; "": none */
    char minus[64]; /* column that is subtracted; "": none */
    char unit[16];  /* of all three; "": the log's own */
    double sign;    /* 1, -1, or any factor */
    double offset;  /* in the log's unit */
};

/* What the columns of a file mean (docs/formats.md, "Mapping"). */
struct mk_import_map {
    char separator, decimal; /* 0: found out from the file */
    enum mk_plant_kind rig;
    double u_to_torque;                       /* N m per unit of command; 0: unknown */
    bool joint_linear[MK_MAX_JOINTS];         /* slides: m, N */
    int encoder_cpr[MK_MAX_JOINTS];           /* 0: unknown */
    double encoder_resolution[MK_MAX_JOINTS]; /* size of a count in the joint's unit; 0: unknown */
    bool no_input;                            /* nothing drove the rig: there is no command */
    int count;
    struct mk_import_column column[MK_IMPORT_COLUMNS];
};

/* Reads a mapping file. MK_ERR_NOTFOUND, MK_ERR_PARSE with file, line and what would be right. */
MK_NODISCARD enum mk_status mk_import_map_read(const char *path, struct mk_import_map *out,
                                               struct mk_error *err);
/* Writes one; reads back equal. */
MK_NODISCARD enum mk_status mk_import_map_write(const char *path, const struct mk_import_map *map,
                                                const char *comment, struct mk_error *err);
/* The entry of the mapping for column `to` of the log; NULL: none. Part of the mapping. */
struct mk_import_column *mk_import_map_find(struct mk_import_map *map, const char *to);

/* Reads a foreign file, text (also .gz) or .mat; text by map->separator and ->decimal, which it
 * sets where they were open. A column's unit is what its name or a line of units says; an entry of
 * the mapping that has no unit, and 1 or -1 for its sign, gets it. */
MK_NODISCARD enum mk_status mk_import_open(const char *path, struct mk_import_map *map,
                                           struct mk_table **out, struct mk_error *err);
/* Fills map->column from the names of the file's columns, for map->rig. MK_ERR_PARSE: time, an
 * angle or the command is not to be recognised; the message lists the columns there are. */
MK_NODISCARD enum mk_status mk_import_guess(const struct mk_table *table, const char *path,
                                            struct mk_import_map *map, struct mk_error *err);
/* The log that a map makes of a file. Time starts at 0. MK_ERR_PARSE: a column that is not there, a
 * unit that does not fit, time that does not increase. The caller frees with mk_log_free. */
MK_NODISCARD enum mk_status mk_import_apply(const struct mk_table *table, const char *path,
                                            const struct mk_import_map *map, struct mk_log **out,
                                            struct mk_error *err);

#define MK_IMPORT_FINDINGS 8

/* Something that cannot be as the map says, or hardly. */
struct mk_import_finding {
    bool certain;       /* no rig of the kind can move like that, or with the change nearly all is
                           explained and without it far less: not to be written. Else a doubt. */
    char what[256];     /* what is wrong, as the data show it */
    char proposal[192]; /* the change to the map; "" when there is none to propose */
    struct mk_import_map fixed;
};

/* Holds an imported log against what rigs of its kind can do: sample times, angles, gravity, the
 * sign of the command, joints swapped. A fit of the textbook model to the accelerations, with no
 * negative mass or friction, says how well the columns go together; a change is proposed under
 * which they do, and none that leaves most unexplained. Returns the number of findings, most
 * certain first. 0: nothing speaks against the map. */
int mk_import_check(const struct mk_table *table, const char *path, const struct mk_import_map *map,
                    struct mk_import_finding *out);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif

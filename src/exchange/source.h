/* Files of other programs as tables: columns under the names they have there. */
#ifndef MECHKIT_EXCHANGE_SOURCE_H
#define MECHKIT_EXCHANGE_SOURCE_H

#include "mechkit/exchange.h"

#ifdef __cplusplus
extern "C" {
#endif

/* How a text file is written; what is 0 is found out. */
struct source_format {
    char separator; /* , ; tab or blank */
    char decimal;   /* . or , */
};

/* Reads a text file with a column a field. Lines that start with # or % are comments. The first
 * other line names the columns unless it is numbers; then they are "1", "2", ... A unit may stand
 * with a name, "angle [deg]" or "time_ms", or in a line of its own below. A field that is no number
 * is NaN. On return *format says what was found. MK_ERR_PARSE names the line. */
MK_NODISCARD enum mk_status source_read_text(const char *path, struct source_format *format,
                                             struct mk_table **out, struct mk_error *err);

/* Reads a MAT file: vectors under their names, fields as "run.signals.q1" or "run(2).t", cells as
 * "run{1}.t", signals of a matrix as "Y(:,2)" or, where it lies, "Y(2,:)". All of them must have
 * the same length: that of the column `like`, or (NULL, or none of that name) the one that most
 * have. The table says what was left out. */
MK_NODISCARD enum mk_status source_read_mat(const char *path, const char *like,
                                            struct mk_table **out, struct mk_error *err);

/* The rig of a map: its plant, how its joints move, what their encoders count. */
void map_model(const struct mk_import_map *map, struct mk_model *out);

/* Whether a column can go by this name in a mapping file: not with what ends a value there. */
bool map_can_name(const char *column);

#ifdef __cplusplus
}
#endif
#endif

/* The list of subcommands. Each is a file sub_NAME.c with its table of options and its text of
 * help. */
#include "console/commands/sub.h"

const struct subcommand *subcommand_at(int index)
{
    static const struct subcommand *const list[] = {
        &sub_run,     &sub_console,    &sub_simulate,    &sub_identify, &sub_excite,
        &sub_measure, &sub_explain,    &sub_investigate, &sub_design,   &sub_boards,
        &sub_doctor,  &sub_standalone, &sub_serve,       &sub_summary,  &sub_plot,
        &sub_export,  &sub_import,     &sub_robustness,  &sub_sweep};
    const int count = (int)(sizeof list / sizeof list[0]);
    return index >= 0 && index < count ? list[index] : NULL;
}

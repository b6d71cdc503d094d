/* mechkit: the program. Finds the subcommand; each lives in a file sub_NAME.c. */
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "console/sub.h"

static const struct subcommand subcommands[] = {
    {"run", "execute a command file on a board",
     "usage: mechkit run SCRIPT.cmd [options]\n"
     "\n"
     "Executes a command file headless (\"-\": standard input).\n"
     "\n"
     "  --board NAME     virtual (default), usb, parport (docs/boards.md), null\n"
     "  --model M.ini    the rig; default: the rig of the setup with the report's parameters\n"
     "  --believe M.ini  what the controller believes; default: the same model\n"
     "  --fast           virtual board in simulated time, as fast as it goes\n"
     "  --out DIR        where logs go; made if missing; default: the current directory\n"
     "  --rate HZ        samples per second, 100 .. 2000; default 500\n"
     "  --seed N         of the virtual rig's noise; default 1\n"
     "  --device NAME    which board, when there are several\n"
     "  --check          parse only: report every error in the script, run nothing\n"
     "  --quiet          print errors only\n"
     "\n"
     "`mechkit run --commands` lists the commands.\n",
     sub_run},
    {"console", "the operator's screen",
     "usage: mechkit console [SCRIPT.cmd] [options]\n"
     "\n"
     "A text screen over a board: setup, start, halt, gains, save, identify, explain. Executes "
     "the\n"
     "command file first if there is one. Keys: ? lists them; Space stops the motor at once.\n"
     "\n"
     "  --board NAME     virtual (default), usb, parport (docs/boards.md), null\n"
     "  --model M.ini    the rig; default: the rig of the setup with the report's parameters\n"
     "  --believe M.ini  what the controller believes; default: the same model\n"
     "  --fast           virtual board in simulated time, ten times as fast as the clock\n"
     "  --out DIR        where logs go; made if missing; default: the current directory\n"
     "  --rate HZ        samples per second, 100 .. 2000; default 500\n"
     "  --seed N         of the virtual rig's noise; default 1\n"
     "  --device NAME    which board, when there are several\n"
     "  --setup NAME     choose this setup at once\n"
     "  --replay LOG     show a log; no board is needed\n"
     "  --mono           no colours (also with NO_COLOR in the environment)\n"
     "  --ascii          no characters beyond ASCII\n",
     sub_console},
    {"simulate", "predict a log by driving a model with its command",
     "usage: mechkit simulate --model M.ini --input LOG.csv [--out PRED.csv] [options]\n"
     "\n"
     "Drives the model by the log's command (zero-order hold) from the log's start and writes\n"
     "t,q1,q2,dq1,dq2 on the log's own time base.\n"
     "\n"
     "  --window S      start again from the data every S seconds; adds a column window\n"
     "  --solver NAME   arkode-erk (default), cvode-adams, cvode-bdf, dop853\n"
     "  --states        also columns x1, x2, ...: joints, their speeds, the effects' states\n"
     "  --json FILE     figures per joint (rms, nrmse); \"-\": standard output\n",
     sub_simulate},
    {"identify", "fit a model's parameters to logs",
     "usage: mechkit identify --model M.ini --out FITTED.ini [options] LOG.csv...\n"
     "\n"
     "Fits [parameters], and those of the effects in the model, and says how well they are known.\n"
     "\n"
     "  --method NAME     output-error (default): maximum likelihood of the measured angles;\n"
     "                    olsen, swevers, wls, sls, energy: linear, base parameters only\n"
     "  --json FILE       the result with covariance; \"-\": standard output\n"
     "  --fix NAME        hold a parameter, as p5 or effect.backlash.width; may be repeated\n"
     "  --validate V.csv  free-run error on a log that was not fitted; may be repeated\n"
     "  --cutoff HZ       linear methods: averaging over windows of 1 / HZ; default 3\n"
     "  --threads N       default: all processors\n",
     sub_identify},
    {"excite", "find the input that tells most about a rig's parameters",
     "usage: mechkit excite --model M.ini --out NAME.cmd [options]\n"
     "\n"
     "Searches for an experiment of a given length and within limits, and writes it as a command\n"
     "file. The foreseen standard errors are relative, those of output-error fits of its log.\n"
     "\n"
     "  --criterion NAME  worst, a, d: largest standard error, trace or determinant of the\n"
     "                    covariance; the input is a multisine. condition, condition-unscaled: of\n"
     "                    the regressor along a trajectory (rigs with a motor on every joint)\n"
     "                    default: condition where it can be, else worst\n"
     "  --seconds S       default 10\n"
     "  --rate HZ         of the loop; default 500\n"
     "  --harmonics N     2 .. 12; default 5 for a trajectory, 8 for an input\n"
     "  --u-max U         limit of the command; default 70 % of the rig's\n"
     "  --q1, --q2 LO:HI  limits of the angles, rad; default half a turn either way\n"
     "  --v1, --v2 V      limits of the speeds, rad/s\n"
     "  --drift D         process noise that the rig may have, rad/s per sqrt(s); default 1e-4\n"
     "  --spread P        how far the parameters may be off, as 0.1; default 0: trust the model\n"
     "  --fix NAME        a parameter that will not be fitted; may be repeated\n"
     "  --against SIGNAL  input to compare with; default U*sin(6*t)\n"
     "  --tries N         inputs to try; default 9000\n"
     "  --seed N          of the search; default 1\n"
     "  --json FILE       the result; \"-\": standard output\n"
     "  --threads N       default: all processors\n",
     sub_excite},
    {"measure", "simple experiments: friction, inertia, free swings, torque constant",
     "usage: mechkit measure KIND --model M.ini [options] LOG.csv...\n"
     "\n"
     "Reads a number or two off the logs of a simple experiment (scripts/measure-*.cmd). KIND:\n"
     "\n"
     "  friction  Coulomb and viscous, both ways: inertia wheel, runs at constant speed\n"
     "  inertia   inertia wheel, runs at constant acceleration\n"
     "  swing     natural frequency and inertia: pendulum or reaction wheel, free swings\n"
     "  torque    m g l in command units: pendulum, slow sweep\n"
     "\n"
     "  --known X    inertia (kg m^2) or m g l (N m) from scales and drawing: inertia and torque\n"
     "               then give the torque constant\n"
     "  --out M.ini  the model with what was measured\n"
     "  --json FILE  the result with all pieces of the logs; \"-\": standard output\n",
     sub_measure},
    {"explain", "find out what the simulation gets wrong, and why",
     "usage: mechkit explain --model M.ini --out DIR [--holdout V.csv]... LOG.csv...\n"
     "\n"
     "Compares the model with the logs, names what it lacks, extends it, and measures the gain on\n"
     "the hold-out logs (without any, on the end of the last log). Writes report.html,\n"
     "report.json and extended.ini to DIR, and next.cmd where an experiment would tell more.\n"
     "\n"
     "  --next           propose an experiment even where no rival is left open\n"
     "  --holdout V.csv  a log to measure on; may be repeated\n"
     "  --window S       length of the free runs that are compared; default 1\n"
     "  --seconds S|all  most data to search in, from the starts of the logs; default 60\n"
     "  --threads N      default: all processors\n",
     sub_explain},
    {"design", "linearise a rig and compute feedback gains",
     "usage: mechkit design --model M.ini [options]\n"
     "\n"
     "Prints A and B at an equilibrium, controllability, gains and closed-loop poles. The states\n"
     "come in the order in which the command `gains` takes their gains.\n"
     "\n"
     "  --at NAME       equilibrium, as hanging, mid, top; default: the inverted one\n"
     "  --poles LIST    place the poles, e.g. \"-10 -10 -5+3i -5-3i\"\n"
     "  --lqr LIST      continuous LQR: weights of the states; of u, e.g. \"10 1 10 1; 0.5\"\n"
     "  --lqrd LIST     the same problem for a command held between samples\n"
     "  --delay         with --lqrd: the command acts a sample late; one more gain\n"
     "  --gains LIST    no design: the closed loop of these gains\n"
     "  --rate HZ       sample rate for --lqrd; default 500\n"
     "  --friction      keep the friction of the motor joint in the linearisation\n"
     "  --json FILE     the result; \"-\": standard output\n",
     sub_design},
    {"boards", "which boards are there, and may they be used",
     "usage: mechkit boards\n"
     "\n"
     "Lists the boards of every kind with what --board and --device take, and what stands in the\n"
     "way of using them. Moves nothing.\n",
     sub_boards},
    {"doctor", "look at machine, board and rig: what is well, what is not, what to do",
     "usage: mechkit doctor [options]\n"
     "\n"
     "A line a finding: ok, problem with what to do, or skipped. Exit code 1 when there is a\n"
     "problem. Without --drive the motor stays off.\n"
     "\n"
     "  --board NAME     usb, parport, virtual (default)\n"
     "  --device NAME    which board, when there are several\n"
     "  --model M.ini    the rig; default: the pendubot with the report's parameters\n"
     "  --hand           asks for the joints to be turned by hand: does each encoder count?\n"
     "  --drive          two short pushes and a slow sweep: wiring, swapped encoders, cable drag\n"
     "  --fast           virtual board in simulated time\n",
     sub_doctor},
    {"standalone", "let the board's own controller run, and fetch what it recorded",
     "usage: mechkit standalone SETUP [options]\n"
     "\n"
     "The board controls the rig by itself, as the original kit did: the setup and its gains go\n"
     "down, it starts, halts, and the recorded arrays come up as a log. The links must hang "
     "still.\n"
     "Setups: pendubot-mid, pendubot-top, reaction-wheel, furuta, pi-speed.\n"
     "\n"
     "  --board NAME     usb, parport, virtual (default)\n"
     "  --device NAME    which board, when there are several\n"
     "  --model M.ini    the rig; default: the rig of the setup with the report's parameters\n"
     "  --gains LIST     the first gains of the setup (docs/protocol.md); default: the board's\n"
     "  --seconds S      how long; default 10\n"
     "  --rate HZ        samples per second; default 500\n"
     "  --every N        samples a record; default: so that the arrays last\n"
     "  --out LOG.csv    where the recorded arrays go; default: standalone.csv\n"
     "  --fast           virtual board in simulated time\n",
     sub_standalone},
    {"summary", "what happened in runs, a line a log",
     "usage: mechkit summary LOG.csv...\n"
     "\n"
     "Prints for each log: setup, length, when it was caught, how still it was held, command, and\n"
     "lateness of the loop.\n",
     sub_summary},
    {"plot", "draw logs as SVG, PNG or in the terminal (needs gnuplot)",
     "usage: mechkit plot LOG.csv... [--out FILE.svg|FILE.png] [options]\n"
     "\n"
     "Angles, command and phase plane of up to eight runs over each other; the hand-over of a\n"
     "single one is marked. Without --out it is drawn in the terminal.\n"
     "\n"
     "  --with PRED.csv  a prediction over the angles (mechkit simulate), and its error\n"
     "  --spectrum       spectra of command and angles, and the response between them: gain, "
     "phase\n"
     "                   and coherence (Welch)\n"
     "  --phase          phase plane of every joint\n"
     "  --title TEXT     default: setup and rig\n"
     "  --size WxH       pixels, or characters of a panel in the terminal\n",
     sub_plot},
    {"export", "logs and models for MATLAB, Octave, C and others",
     "usage: mechkit export LOG.csv... --out FILE.mat|FILE.csv [options]\n"
     "       mechkit export --model M.ini --out NAME.m|NAME.c|NAME.fmu\n"
     "\n"
     "A .mat file holds a struct array, an element a log: time, signals, units, parameters, "
     "gains,\n"
     "metadata, and the matrix Y with its column names. A .csv file holds one log.\n"
     "\n"
     "Without logs the model itself is written: as a function for Octave and MATLAB (.m), or as C\n"
     "with an integrator (.c and .h), as an FMU for co-simulation (FMI 2.0). docs/matlab.md says\n"
     "how they are used.\n"
     "\n"
     "  --columns LIST   which, in which unit: t:ms,q1:deg,u:Nm; default: all, in the log's units\n"
     "  --format NAME    v5 (default) or v7.3 (HDF5)\n"
     "  --name NAME      of the struct array; default mk\n"
     "  --model M.ini    put the model in; says also how many N m a unit of command is\n"
     "  --separator C    of a CSV: , (default), tab, or ; with decimal commas\n"
     "  --plain          a CSV without # lines of metadata\n",
     sub_export},
    {"import", "logs from other people's files, and whether they can be true",
     "usage: mechkit import FILE --map M.map|--rig KIND [--out LOG.csv] [options]\n"
     "\n"
     "Reads text with columns (also .gz) or a .mat file. A mapping says which column is what, in\n"
     "which unit, sign and offset (docs/formats.md); without one the names of the columns do. "
     "Says\n"
     "what was assumed and checks it against how rigs move: unit of time and angles, gravity, "
     "sign\n"
     "of the command, joints swapped. What cannot be is not written, and a mend is proposed: exit\n"
     "code 1.\n"
     "\n"
     "  --rig KIND         inertia-wheel, pendulum, pendubot, reaction-wheel or furuta\n"
     "  --write-map M.map  the mapping, with what is proposed\n"
     "  --force            write the log whatever speaks against it\n"
     "  --json FILE        what was assumed and found; \"-\": standard output\n",
     sub_import},
    {"robustness", "catch and hold rigs that differ from what the controller believes",
     "usage: mechkit robustness [options]\n"
     "\n"
     "Runs each balancing setup on the virtual board, in simulated time, on rigs whose parameters\n"
     "are 10 % and friction 30 % off, with one more sample of delay and encoders zeroed up to 2\n"
     "counts off. Prints how many were caught within 15 s and held for 10 s, and what failed.\n"
     "Exit code 1 when a setup holds less than 95 %.\n"
     "\n"
     "  --setup NAME   one setup; default: all four\n"
     "  --seeds N      rigs a setup; default 200\n"
     "  --first N      seed of the first; default 1\n"
     "  --delay N      samples of delay beyond the board's own; default 1\n"
     "  --rate HZ      samples per second; default 500\n"
     "  --json FILE    the figures; \"-\": standard output\n",
     sub_robustness},
};

#define COUNT (sizeof subcommands / sizeof subcommands[0])

static void print_help(FILE *out)
{
    fputs("mechkit " MK_VERSION ": driver and operator console for underactuated lab rigs\n\n"
          "usage: mechkit COMMAND [options]\n\n",
          out);
    for (size_t i = 0; i < COUNT; i++)
        fprintf(out, "  %-10s %s\n", subcommands[i].name, subcommands[i].summary);
    fputs(
        "\n`mechkit COMMAND --help` says more. Exit codes: 0 success, 1 the run or check failed,\n"
        "2 usage, 3 bad input file.\n",
        out);
}

static bool asks_for_help(int argc, char **argv)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++)
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0)
            return true;
    return false;
}

int main(int argc, char **argv)
{
    /* A full disk or a closed pipe must come back as an error, not end the program in mid run. */
    signal(SIGXFSZ, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    if (argc < 2) {
        print_help(stderr);
        return EXIT_WRONG_USAGE;
    }
    if (strcmp(argv[1], "--version") == 0) {
        puts("mechkit " MK_VERSION);
        return EXIT_OK;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
        strcmp(argv[1], "help") == 0) {
        print_help(stdout);
        return EXIT_OK;
    }
    for (size_t i = 0; i < COUNT; i++) {
        if (strcmp(argv[1], subcommands[i].name) != 0)
            continue;
        if (asks_for_help(argc - 1, argv + 1)) {
            fputs(subcommands[i].help, stdout);
            return EXIT_OK;
        }
        return subcommands[i].run(argc - 1, argv + 1);
    }
    return report_usage("", "there is no command '%s'", argv[1]);
}

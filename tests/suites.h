/* The list of test suites: one line a file tests/test_NAME.c, which defines suite_NAME(). */
#ifndef MECHKIT_TESTS_SUITES_H
#define MECHKIT_TESTS_SUITES_H

#include <check.h>

#define MK_SUITES(X)                                                                               \
    X(status)                                                                                      \
    X(number)                                                                                      \
    X(ring)                                                                                        \
    X(clock)                                                                                       \
    X(json)                                                                                        \
    X(log)                                                                                         \
    X(floors)                                                                                      \
    X(log_writer)                                                                                  \
    X(design)                                                                                      \
    X(design_cli)                                                                                  \
    X(signal)                                                                                      \
    X(velocity)                                                                                    \
    X(plants)                                                                                      \
    X(effects)                                                                                     \
    X(fast)                                                                                        \
    X(sim)                                                                                         \
    X(predict)                                                                                     \
    X(fit)                                                                                         \
    X(mass_range)                                                                                  \
    X(free_runs)                                                                                   \
    X(predictions)                                                                                 \
    X(inputs)                                                                                      \
    X(misfit)                                                                                      \
    X(places)                                                                                      \
    X(own_values)                                                                                  \
    X(slides)                                                                                      \
    X(model_file)                                                                                  \
    X(script)                                                                                      \
    X(console)                                                                                     \
    X(save)                                                                                        \
    X(simulate_cli)                                                                                \
    X(options)                                                                                     \
    X(console_pty)                                                                                 \
    X(tui)                                                                                         \
    X(safety)                                                                                      \
    X(residual)                                                                                    \
    X(rig)                                                                                         \
    X(ctrl)                                                                                        \
    X(balance)                                                                                     \
    X(compensate)                                                                                  \
    X(swingup)                                                                                     \
    X(trajectory)                                                                                  \
    X(roa)                                                                                         \
    X(robustness)                                                                                  \
    X(loop)                                                                                        \
    X(loop_log)                                                                                    \
    X(loop_params)                                                                                 \
    X(loop_samples)                                                                                \
    X(loop_faults)                                                                                 \
    X(loop_lies)                                                                                   \
    X(loop_start)                                                                                  \
    X(loop_thread)                                                                                 \
    X(frame)                                                                                       \
    X(wire)                                                                                        \
    X(device)                                                                                      \
    X(device_stream)                                                                               \
    X(board)                                                                                       \
    X(standalone)                                                                                  \
    X(doctor)                                                                                      \
    X(usb)                                                                                         \
    X(parport)                                                                                     \
    X(ppdev)                                                                                       \
    X(streams)                                                                                     \
    X(stream_troubles)                                                                             \
    X(tcp)                                                                                         \
    X(serial)                                                                                      \
    X(serve)                                                                                       \
    X(foreign)                                                                                     \
    X(boards_cli)                                                                                  \
    X(bus_runs)                                                                                    \
    X(replug)                                                                                      \
    X(bus_faults)                                                                                  \
    X(fault_script)                                                                                \
    X(shoot)                                                                                       \
    X(contact)                                                                                     \
    X(signals)                                                                                     \
    X(linear)                                                                                      \
    X(ratios)                                                                                      \
    X(excite)                                                                                      \
    X(measure)                                                                                     \
    X(data_check)                                                                                  \
    X(carry_over)                                                                                  \
    X(explain)                                                                                     \
    X(explain_data)                                                                                \
    X(explain_report)                                                                              \
    X(hidden)                                                                                      \
    X(investigate)                                                                                 \
    X(exchange)                                                                                    \
    X(export_model)                                                                                \
    X(import)                                                                                      \
    X(plausible)                                                                                   \
    X(plot)                                                                                        \
    X(pack)                                                                                        \
    X(sweep)

#ifdef __cplusplus
extern "C" {
#endif
#define MK_SUITE_DECL(name) Suite *suite_##name(void);
MK_SUITES(MK_SUITE_DECL)
#undef MK_SUITE_DECL
#ifdef __cplusplus
}
#endif

#endif

// The wide instruction sets that this machine has. Kernels are compiled for each (Makefile:
// ISA_FLAGS) and chosen when the program runs.
#ifndef MECHKIT_SIM_INSTRUCTION_SETS_HPP
#define MECHKIT_SIM_INSTRUCTION_SETS_HPP

#ifdef MK_WIDE_KERNELS // set by the Makefile where they are built

namespace mk
{

inline bool has_avx2()
{
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
           __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
}

inline bool has_avx512()
{
    return has_avx2() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512vl");
}

} // namespace mk

#endif
#endif

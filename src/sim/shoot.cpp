// Chooses the shooting kernel for the machine and for the number of derivatives.
#include "sim/shoot.hpp"

namespace mk
{

#define MK_DECLARE_KERNELS(isa)                                                                    \
    namespace isa_##isa##_0                                                                        \
    {                                                                                              \
        extern const ShootKernel shoot_kernel;                                                     \
    }                                                                                              \
    namespace isa_##isa##_8                                                                        \
    {                                                                                              \
        extern const ShootKernel shoot_kernel;                                                     \
    }                                                                                              \
    namespace isa_##isa##_16                                                                       \
    {                                                                                              \
        extern const ShootKernel shoot_kernel;                                                     \
    }                                                                                              \
    namespace isa_##isa##_24                                                                       \
    {                                                                                              \
        extern const ShootKernel shoot_kernel;                                                     \
    }
MK_DECLARE_KERNELS(generic)
#ifdef MK_WIDE_KERNELS // set by the Makefile where they are built
MK_DECLARE_KERNELS(avx2)
MK_DECLARE_KERNELS(avx512)
#endif

namespace
{

constexpr int SIZES = 4;
struct Family {
    const ShootKernel *by_size[SIZES]; // fewest lanes first
};
#define MK_FAMILY(isa)                                                                             \
    {                                                                                              \
        {                                                                                          \
            &isa_##isa##_0::shoot_kernel, &isa_##isa##_8::shoot_kernel,                            \
                &isa_##isa##_16::shoot_kernel, &isa_##isa##_24::shoot_kernel                       \
        }                                                                                          \
    }

const Family &family()
{
    static const Family generic = MK_FAMILY(generic);
#ifdef MK_WIDE_KERNELS
    static const Family avx2 = MK_FAMILY(avx2), avx512 = MK_FAMILY(avx512);
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return avx512;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return avx2;
#endif
    return generic;
}

} // namespace

void shoot(ShootTask &task)
{
    const Family &f = family();
    if (task.columns == 0) {
        f.by_size[0]->run(task, 0);
        return;
    }
    for (int first = 0; first < task.columns;) {
        int size = 1;
        while (size + 1 < SIZES && f.by_size[size]->lanes < task.columns - first)
            size++;
        f.by_size[size]->run(task, first);
        if (!task.finite)
            return;
        first += f.by_size[size]->lanes;
    }
}

} // namespace mk

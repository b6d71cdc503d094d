/* libFuzzer: fault scripts, as a file and as text. What is read asks for something within its
 * samples, and for nothing that is no number. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "driver/fault_script.h"
#include "fuzz_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static __attribute__((noinline)) void must(int holds)
{
    if (!holds)
        abort();
}

static void look_at(const struct mk_fault_script *s, uint64_t sample)
{
    struct mk_fault_effects fx;
    mk_fault_script_at(s, sample, &fx);
    must(isfinite(fx.delay_s) && fx.delay_s >= 0.0 && isfinite(fx.noise_counts) &&
         fx.noise_counts >= 0.0 && fx.u_limit >= 0.0);
}

static void check(const struct mk_fault_script *s, int joints)
{
    must(s->count >= 0 && s->count <= MK_FAULT_RULES_MAX);
    for (int i = 0; i < s->count; i++) {
        const struct mk_fault_rule *r = &s->rule[i];
        must((int)r->action >= 0 && r->action < MK_FAULT_ACTION_COUNT);
        must(r->first < r->end && r->joint >= 0 && r->joint < joints && isfinite(r->value));
        look_at(s, r->first);
        look_at(s, r->end - 1);
        look_at(s, r->end);
    }
    look_at(s, 0);
    look_at(s, UINT64_MAX);
}

static void read_one(const char *source, int joints)
{
    static struct mk_fault_script s;
    struct mk_error err = MK_ERROR_INIT;
    if (mk_fault_script_read(source, joints, &s, &err) == MK_OK)
        check(&s, joints);
    else
        must(err.message[0] != '\0');
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    int joints = 1 + (size > 0 && (data[0] & 1));
    read_one(fuzz_file(0, data, size), joints);
    char *text = malloc(size + 3 + 1);
    must(text != NULL);
    /* Never a path. */
    memcpy(text, ";  ", 3);
    memcpy(text + 3, data, size);
    text[size + 3] = '\0';
    read_one(text, joints);
    free(text);
    return 0;
}

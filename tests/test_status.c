#include "suites.h"

#include <errno.h>

#include "base/text.h"
#include "mechkit/status.h"

START_TEST(every_code_has_a_name_and_a_text)
{
    static const enum mk_status codes[] = {
#define CODE(name, code, text) MK_##name,
        MK_STATUS_LIST(CODE)
#undef CODE
    };
    for (size_t i = 0; i < sizeof codes / sizeof codes[0]; i++) {
        ck_assert_int_le(codes[i], 0);
        ck_assert_ptr_nonnull(strstr(mk_status_name(codes[i]), "MK_"));
        ck_assert_str_ne(mk_strerror(codes[i]), "unknown status");
    }
    ck_assert_str_eq(mk_status_name((enum mk_status) - 999), "MK_ERR_?");
}
END_TEST

START_TEST(an_error_says_where)
{
    char buf[1024];
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_error_at(&err, MK_ERR_PARSE, "a.csv", 7, 3, "field %d is bad", 3);
    ck_assert_int_eq(st, MK_ERR_PARSE);
    ck_assert_str_eq(mk_error_format(&err, buf, sizeof buf), "a.csv:7:3: field 3 is bad");
    mk_error_set(&err, MK_ERR_RANGE, "too large");
    ck_assert_str_eq(mk_error_format(&err, buf, sizeof buf), "too large");
    ck_assert_int_eq(mk_error_set(NULL, MK_ERR_IO, "ignored"), MK_ERR_IO);
}
END_TEST

START_TEST(system_errors_become_codes)
{
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_error_errno(&err, ENOSPC, "x", "cannot write"), MK_ERR_NOSPACE);
    ck_assert_int_eq(err.os_code, ENOSPC);
    ck_assert_ptr_nonnull(strstr(err.message, "cannot write: "));
    ck_assert_int_eq(mk_error_errno(NULL, EACCES, "x", "no"), MK_ERR_PERM);
}
END_TEST

START_TEST(what_would_steer_a_terminal_is_shown)
{
    static const struct {
        const char *text, *shown;
    } rows[] = {{"", ""},
                {"\x1b[2J\x07\n\x7f", "\\x1b[2J\\x07\\x0a\\x7f"},
                {"Gr\xc3\xb6\xc3\x9f"
                 "e \xe2\x82\xac \xf0\x9f\x98\x80",
                 "Gr\xc3\xb6\xc3\x9f"
                 "e \xe2\x82\xac \xf0\x9f\x98\x80"},
                {"\xc2\x9b"
                 "2J",
                 "\\xc2\\x9b"
                 "2J"},
                {"\x9b\xff\xc3", "\\x9b\\xff\\xc3"}};
    char out[100];
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        ck_assert_str_eq(mk_show_text(out, sizeof out, rows[i].text), rows[i].shown);
    ck_assert_str_eq(mk_show_text(out, 5, "ab\x1b"), "ab");
    ck_assert_str_eq(mk_show_text(out, 7,
                                  "ab\x1b"
                                  "c"),
                     "ab\\x1b");
    ck_assert_str_eq(mk_show_text(out, 3, "a\xc3\xb6"), "a");
}
END_TEST

Suite *suite_status(void)
{
    Suite *s = suite_create("status");
    TCase *t = tcase_create("core");
    tcase_add_test(t, every_code_has_a_name_and_a_text);
    tcase_add_test(t, an_error_says_where);
    tcase_add_test(t, system_errors_become_codes);
    tcase_add_test(t, what_would_steer_a_terminal_is_shown);
    suite_add_tcase(s, t);
    return s;
}

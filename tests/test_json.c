/* Reports: exact numbers, whole files, and a place for every mistake. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "mechkit/json.h"
#include "support/comma_locale.h"
#include "support/files.h"

static cJSON *sample(void)
{
    static const double row[] = {1, 2.5, INFINITY};
    cJSON *root = cJSON_CreateObject();
    cJSON_AddItemToObject(root, "third", mk_json_number(1.0 / 3.0));
    cJSON_AddItemToObject(root, "tiny", mk_json_number(5e-324));
    cJSON_AddItemToObject(root, "none", mk_json_number(NAN));
    cJSON_AddItemToObject(root, "row", mk_json_numbers(row, 3));
    cJSON_AddItemToObject(root, "nothing", mk_json_numbers(NULL, 0));
    return root;
}

static void expect_sample(const char *path)
{
    struct mk_error err = MK_ERROR_INIT;
    cJSON *back;
    ck_assert_msg(mk_json_read(path, &back, &err) == MK_OK, "%s", err.message);
    ck_assert(cJSON_GetObjectItem(back, "third")->valuedouble == 1.0 / 3.0);
    ck_assert(cJSON_GetObjectItem(back, "tiny")->valuedouble == 5e-324);
    ck_assert(cJSON_IsNull(cJSON_GetObjectItem(back, "none")));
    const cJSON *row = cJSON_GetObjectItem(back, "row");
    ck_assert_int_eq(cJSON_GetArraySize(row), 3);
    ck_assert(cJSON_GetArrayItem(row, 1)->valuedouble == 2.5);
    ck_assert(cJSON_IsNull(cJSON_GetArrayItem(row, 2)));
    ck_assert_int_eq(cJSON_GetArraySize(cJSON_GetObjectItem(back, "nothing")), 0);
    cJSON_Delete(back);
}

START_TEST(numbers_stay_exact_and_nan_becomes_null)
{
    struct mk_error err = MK_ERROR_INIT;
    cJSON *root = sample();
    const char *path = scratch("a.json");
    ck_assert_int_eq(mk_json_write(path, root, &err), MK_OK);
    expect_sample(path);
    char *text = slurp_file(path);
    ck_assert_int_eq(text[strlen(text) - 1], '\n');
    ck_assert_ptr_nonnull(strstr(text, "\n\t\"third\":")); /* indented */
    free(text);
    cJSON_Delete(root);
}
END_TEST

START_TEST(a_locale_with_a_decimal_comma_does_not_matter)
{
    struct mk_error err = MK_ERROR_INIT;
    if (!use_comma_locale())
        return;
    cJSON *root = sample();
    cJSON_AddNumberToObject(root, "own", 0.5); /* a number that cJSON itself prints */
    const char *path = scratch("comma.json");
    ck_assert_int_eq(mk_json_write(path, root, &err), MK_OK);
    expect_sample(path);
    char *text = slurp_file(path);
    ck_assert_ptr_nonnull(strstr(text, "0.5"));
    ck_assert_ptr_null(strstr(text, "0,5"));
    free(text);
    cJSON_Delete(root);
}
END_TEST

START_TEST(broken_json_is_refused_with_its_place)
{
    static const struct {
        const char *text;
        int line, column;
    } rows[] = {
        {"{\n  \"a\": 1,\n  \"b\": oops\n}\n", 3, 8},
        {"{\"a\": 1} x\n", 1, 10},
        {"[1, 2", 1, 6},
        {"", 0, 0},
        {" \n\n", 0, 0},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct mk_error err = MK_ERROR_INIT;
        cJSON *back;
        const char *path = scratch_text("b.json", rows[i].text);
        ck_assert_int_eq(mk_json_read(path, &back, &err), MK_ERR_PARSE);
        ck_assert_ptr_null(back);
        ck_assert_str_eq(err.file, path);
        ck_assert_msg(err.line == rows[i].line && err.column == rows[i].column, "'%s' at %d:%d: %s",
                      rows[i].text, err.line, err.column, err.message);
    }
    struct mk_error err = MK_ERROR_INIT;
    cJSON *back;
    FILE *f = fopen(scratch("zero.json"), "wb");
    fwrite("{}\0{}", 1, 5, f);
    fclose(f);
    ck_assert_int_eq(mk_json_read(scratch("zero.json"), &back, &err), MK_ERR_PARSE);
}
END_TEST

START_TEST(a_file_that_cannot_be_read_says_why)
{
    struct mk_error err = MK_ERROR_INIT;
    cJSON *back;
    ck_assert_int_eq(mk_json_read(scratch("none.json"), &back, &err), MK_ERR_NOTFOUND);
    ck_assert_ptr_nonnull(strstr(err.message, "cannot read"));
    ck_assert_int_eq(mk_json_read("/tmp", &back, &err), MK_ERR_IO);
    ck_assert_ptr_null(back);
}
END_TEST

START_TEST(a_large_document_is_read_whole)
{
    struct mk_error err = MK_ERROR_INIT;
    size_t count = 50000;
    double *values = calloc(count, sizeof *values);
    for (size_t i = 0; i < count; i++)
        values[i] = sqrt((double)i);
    cJSON *root = mk_json_numbers(values, count), *back;
    const char *path = scratch("large.json");
    ck_assert_int_eq(mk_json_write(path, root, &err), MK_OK);
    ck_assert_int_eq(mk_json_read(path, &back, &err), MK_OK);
    size_t i = 0;
    const cJSON *item;
    cJSON_ArrayForEach(item, back) ck_assert(item->valuedouble == values[i++]);
    ck_assert_uint_eq(i, count);
    cJSON_Delete(root);
    cJSON_Delete(back);
    free(values);
}
END_TEST

START_TEST(a_failed_write_keeps_the_old_file_and_leaves_no_other)
{
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch_text("old.json", "{\"old\": true}\n");
    cJSON *root = cJSON_CreateArray(), *back;
    for (int i = 0; i < 5000; i++)
        cJSON_AddItemToArray(root, mk_json_number(i / 3.0));
    limit_file_size(1000);
    enum mk_status st = mk_json_write(path, root, &err);
    limit_file_size(0);
    ck_assert_int_eq(st, MK_ERR_NOSPACE);
    ck_assert_str_eq(err.file, path);
    ck_assert_int_eq(mk_json_read(path, &back, &err), MK_OK);
    ck_assert(cJSON_IsTrue(cJSON_GetObjectItem(back, "old")));
    ck_assert_int_eq(count_files("old.json*"), 1);
    cJSON_Delete(back);
    cJSON_Delete(root);
}
END_TEST

START_TEST(devices_and_directories_are_written_to_or_refused_never_replaced)
{
    struct mk_error err = MK_ERROR_INIT;
    struct stat info;
    cJSON *root = sample();
    ck_assert_int_eq(mk_json_write("/dev/full", root, &err), MK_ERR_NOSPACE);
    ck_assert_int_eq(mk_json_write("/dev/null", root, &err), MK_OK);
    ck_assert(stat("/dev/null", &info) == 0 && S_ISCHR(info.st_mode));
    ck_assert_int_eq(mk_json_write("/tmp", root, &err), MK_ERR_IO);
    ck_assert_int_eq(mk_json_write(scratch("no/such/place.json"), root, &err), MK_ERR_NOTFOUND);
    cJSON_Delete(root);
}
END_TEST

START_TEST(a_minus_means_standard_output)
{
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("out.json");
    cJSON *root = sample();
    ck_assert_ptr_nonnull(freopen(path, "w", stdout));
    ck_assert_int_eq(mk_json_write("-", root, &err), MK_OK);
    expect_sample(path);
    ck_assert_ptr_nonnull(freopen("/dev/full", "w", stdout));
    ck_assert_int_eq(mk_json_write("-", root, &err), MK_ERR_NOSPACE);
    cJSON_Delete(root);
}
END_TEST

Suite *suite_json(void)
{
    Suite *s = suite_create("json");
    TCase *t = tcase_create("files");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, numbers_stay_exact_and_nan_becomes_null);
    tcase_add_test(t, a_locale_with_a_decimal_comma_does_not_matter);
    tcase_add_test(t, broken_json_is_refused_with_its_place);
    tcase_add_test(t, a_file_that_cannot_be_read_says_why);
    tcase_add_test(t, a_large_document_is_read_whole);
    tcase_add_test(t, a_failed_write_keeps_the_old_file_and_leaves_no_other);
    tcase_add_test(t, devices_and_directories_are_written_to_or_refused_never_replaced);
    tcase_add_test(t, a_minus_means_standard_output);
    suite_add_tcase(s, t);
    return s;
}

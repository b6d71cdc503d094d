// Models as source text of other languages, in files.
#include <cctype>
#include <new>
#include <string>

#include "base/out_file.h"
#include "exchange/export_file.hpp"
#include "exchange/source_text.hpp"
#include "mechkit/exchange.h"

namespace mk
{

enum mk_status write_text(const std::string &path, const std::string &text, mk_error *err)
{
    return mk_out_file_save(path.c_str(), text.data(), text.size(), err);
}

// Two files of which neither is of use without the other: both are on the disk before the first
// gets its name.
static enum mk_status write_both(const std::string &path, const std::string &text,
                                 const std::string &other_path, const std::string &other_text,
                                 mk_error *err)
{
    mk_out_file file, other;
    enum mk_status st = mk_out_file_open(&file, path.c_str(), err);
    if (st != MK_OK)
        return st;
    st = mk_out_file_open(&other, other_path.c_str(), err);
    if (st != MK_OK)
        return mk_out_file_finish(&file, st, err);
    st = mk_out_file_write(&file, text.data(), text.size(), err);
    if (st == MK_OK)
        st = mk_out_file_write(&other, other_text.data(), other_text.size(), err);
    const int failure = st == MK_OK ? mk_sync(other.fd) : 0;
    if (failure)
        st = mk_error_errno(err, failure, other_path.c_str(), "cannot write");
    st = mk_out_file_finish(&file, st, err);
    return mk_out_file_finish(&other, st, err);
}

// Words of C, MATLAB or Octave, of which no function can be called.
static bool is_keyword(const std::string &name)
{
    static const char *const words[] = {
        "auto",       "break",    "case",     "catch",    "char",     "classdef",  "const",
        "continue",   "default",  "do",       "double",   "else",     "elseif",    "end",
        "enum",       "extern",   "float",    "for",      "function", "global",    "goto",
        "if",         "inline",   "int",      "long",     "main",     "otherwise", "parfor",
        "persistent", "register", "restrict", "return",   "short",    "signed",    "sizeof",
        "spmd",       "static",   "struct",   "switch",   "try",      "typedef",   "union",
        "unsigned",   "until",    "void",     "volatile", "while"};
    for (const char *word : words)
        if (name == word)
            return true;
    return false;
}

// "dir/pendubot.c" gives "dir/" and "pendubot"; the name becomes the function's.
enum mk_status split_path(const std::string &path, std::string &folder, std::string &name,
                          mk_error *err)
{
    size_t slash = path.find_last_of('/');
    folder = slash == std::string::npos ? "" : path.substr(0, slash + 1);
    std::string file = path.substr(folder.size());
    name = file.substr(0, file.find_last_of('.'));
    bool good =
        !name.empty() && name.size() <= 60 && std::isalpha(static_cast<unsigned char>(name[0]));
    for (char c : name)
        good = good && (std::isalnum(static_cast<unsigned char>(c)) || c == '_');
    if (good && is_keyword(name))
        return mk_error_set(
            err, MK_ERR_USAGE,
            "%s: the file's name is the function's name too, and %s is a word of the "
            "language",
            path.c_str(), name.c_str());
    return good ? MK_OK
                : mk_error_set(err, MK_ERR_USAGE,
                               "%s: the file's name is the function's name too: a letter, then "
                               "letters, digits and _",
                               path.c_str());
}

} // namespace mk

using namespace mk;

enum mk_status mk_export_octave(const char *path, const mk_model *model, mk_error *err)
try {
    std::string folder, name;
    enum mk_status st = split_path(path, folder, name, err);
    if (st != MK_OK)
        return st;
    SymbolicModel s;
    symbolic_model(*model, s);
    return write_text(path, octave_source(s, name), err);
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
}

enum mk_status mk_export_c(const char *path, const mk_model *model, mk_error *err)
try {
    std::string folder, name;
    enum mk_status st = split_path(path, folder, name, err);
    if (st != MK_OK)
        return st;
    SymbolicModel s;
    symbolic_model(*model, s);
    return write_both(folder + name + ".h", c_header(s, name), path, c_source(s, name), err);
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
}

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
    st = write_text(folder + name + ".h", c_header(s, name), err);
    return st == MK_OK ? write_text(path, c_source(s, name), err) : st;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
}

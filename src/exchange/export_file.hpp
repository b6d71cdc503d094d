// What exports have in common: names of functions from names of files, and writing text.
#ifndef MECHKIT_EXCHANGE_EXPORT_FILE_HPP
#define MECHKIT_EXCHANGE_EXPORT_FILE_HPP

#include <string>

#include "mechkit/status.h"

namespace mk
{

// "dir/pendubot.c" gives "dir/" and "pendubot", the function's name. MK_ERR_USAGE when it cannot
// be.
enum mk_status split_path(const std::string &path, std::string &folder, std::string &name,
                          mk_error *err);
// Writes a file, atomically.
enum mk_status write_text(const std::string &path, const std::string &text, mk_error *err);

} // namespace mk
#endif

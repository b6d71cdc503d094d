// An FMU in its file: sources, description, and what the C compiler makes of them.
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <new>
#include <spawn.h>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include "base/temporary.h"
#include "base/zip.h"
#include "exchange/export_file.hpp"
#include "exchange/source_text.hpp"
#include "mechkit/exchange.h"

extern char **environ;

using namespace mk;

namespace
{

// A folder that is gone with its files when the object is, or when a signal ends the program.
class Workshop
{
  public:
    Workshop() = default;
    ~Workshop()
    {
        if (folder_.path)
            mk_temporary_folder_close(&folder_);
        for (char *file : files_)
            mk_temporary_done(file);
    }
    Workshop(const Workshop &) = delete;
    Workshop &operator=(const Workshop &) = delete;
    enum mk_status open(mk_error *err)
    {
        return mk_temporary_folder_open(&folder_, nullptr, "mechkit-fmu", err);
    }
    std::string file(const std::string &name)
    {
        const std::string path = folder_.path + ("/" + name);
        files_.push_back(strdup(path.c_str()));
        mk_temporary_add(files_.back());
        return path;
    }

  private:
    mk_temporary_folder folder_ = {nullptr, -1};
    std::vector<char *> files_;
};

bool slurp(const std::string &path, std::string &out)
{
    FILE *f = std::fopen(path.c_str(), "rb");
    if (!f)
        return false;
    char block[65536];
    size_t n;
    while ((n = std::fread(block, 1, sizeof block, f)) > 0)
        out.append(block, n);
    bool good = !std::ferror(f);
    std::fclose(f);
    return good;
}

// The line with the first error, or the first line, as ": LINE"; empty where it said nothing.
std::string first_complaint(const std::string &path)
{
    std::string all;
    if (!slurp(path, all) || all.empty())
        return "";
    const size_t error = all.find("error: ");
    size_t begin = error == std::string::npos ? 0 : all.rfind('\n', error);
    begin = begin == std::string::npos ? 0 : all.find_first_not_of('\n', begin);
    return begin == std::string::npos ? ""
                                      : ": " + all.substr(begin, all.find('\n', begin) - begin);
}

// Runs the C compiler; what it says goes to the file `complaints`. MK_ERR_NOTFOUND: there is none.
enum mk_status compile_library(const std::string &library, const std::vector<std::string> &sources,
                               const std::string &complaints, mk_error *err)
{
    const char *cc = std::getenv("CC");
    std::vector<std::string> words = {cc && *cc ? cc : "cc", "-shared", "-fPIC", "-O2",  "-std=c99",
                                      "-fvisibility=hidden", "-w",      "-o",    library};
    words.insert(words.end(), sources.begin(), sources.end());
    words.push_back("-lm");
    std::vector<char *> argv;
    for (std::string &w : words)
        argv.push_back(w.data());
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, complaints.c_str(),
                                     O_WRONLY | O_CREAT | O_TRUNC, 0600);
    pid_t child = 0;
    int failure = posix_spawnp(&child, argv[0], &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (failure != 0)
        return mk_error_set(err, MK_ERR_NOTFOUND, "there is no C compiler '%s'", argv[0]);
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return MK_OK;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
        return mk_error_set(err, MK_ERR_NOTFOUND, "there is no C compiler '%s'", argv[0]);
    return mk_error_set(err, MK_ERR_EXPECT, "%s cannot compile the model%s", argv[0],
                        first_complaint(complaints).c_str());
}

struct Sources {
    std::string name, header, model, wrapper, description;
};

// The library that the sources make; empty, with MK_OK, where there is no compiler.
enum mk_status build(const Sources &s, std::string &library, mk_error *err)
{
    Workshop shop;
    enum mk_status st = shop.open(err);
    if (st != MK_OK)
        return st;
    std::string model = shop.file(s.name + ".c"), wrapper = shop.file(s.name + "_fmu.c");
    std::string out = shop.file(s.name + ".so");
    st = write_text(shop.file(s.name + ".h"), s.header, err);
    if (st == MK_OK)
        st = write_text(model, s.model, err);
    if (st == MK_OK)
        st = write_text(wrapper, s.wrapper, err);
    if (st == MK_OK)
        st = compile_library(out, {model, wrapper}, shop.file("complaints"), err);
    if (st == MK_ERR_NOTFOUND)
        return MK_OK;
    if (st == MK_OK && !slurp(out, library))
        st = mk_error_errno(err, errno, out.c_str(), "cannot read");
    return st;
}

} // namespace

enum mk_status mk_export_fmu(const char *path, const mk_model *model, bool *compiled, mk_error *err)
try {
    std::string folder, library;
    Sources s;
    enum mk_status st = split_path(path, folder, s.name, err);
    if (st != MK_OK)
        return st;
    SymbolicModel symbols;
    symbolic_model(*model, symbols);
    s.header = c_header(symbols, s.name);
    s.model = c_source(symbols, s.name);
    s.wrapper = fmu_source(symbols, s.name);
    s.description = fmu_description(symbols, s.name);
    st = build(s, library, err);
    if (st != MK_OK)
        return st;
    *compiled = !library.empty();
    const std::string names[] = {"modelDescription.xml", "sources/" + s.name + ".h",
                                 "sources/" + s.name + ".c", "sources/" + s.name + "_fmu.c",
                                 "binaries/linux64/" + s.name + ".so"};
    const std::string *data[] = {&s.description, &s.header, &s.model, &s.wrapper, &library};
    mk_zip_entry entries[5];
    for (int i = 0; i < 5; i++)
        entries[i] = {names[i].c_str(), data[i]->data(), data[i]->size()};
    return mk_zip_write(path, entries, *compiled ? 5 : 4, err);
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
}

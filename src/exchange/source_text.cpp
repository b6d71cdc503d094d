#include "exchange/source_text.hpp"

#include <string_view>

namespace mk
{

std::string fill(const char *text, const std::vector<std::pair<std::string, std::string>> &words)
{
    std::string out;
    for (const char *c = text; *c;) {
        bool found = false;
        for (const auto &word : words) {
            if (*c != '@')
                break;
            std::string mark = "@" + word.first + "@";
            if (std::string_view(c).substr(0, mark.size()) != mark)
                continue;
            out += word.second;
            c += mark.size();
            found = true;
            break;
        }
        if (!found)
            out += *c++;
    }
    return out;
}

std::string upper(const std::string &name)
{
    std::string out = name;
    for (char &c : out)
        c = c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    return out;
}

std::string describe(const SymbolicModel &s)
{
    std::string out = std::string("Model of a ") + s.plant->name;
    for (int i = 0; i < s.model.effect_count; i++) {
        const mk_effect_use &use = s.model.effect[i];
        out += (i == 0 ? " with " : ", ") + std::string(mk_effect(use.index)->name);
        if (use.joint > 0)
            out += " at joint " + std::to_string(use.joint);
    }
    return out;
}

} // namespace mk

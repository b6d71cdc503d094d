#include "exchange/emit.hpp"

#include <cstring>

#include "mechkit/number.h"

namespace mk
{

const char *indent(Language language)
{
    return language == Language::C ? "    " : "  ";
}

namespace
{

// How tightly the outermost operator of a text binds.
enum Binding { SUM = 1, PRODUCT = 2, SIGN = 3, ATOM = 4 };

struct Text {
    std::string text;
    Binding binding = ATOM;
};

constexpr size_t LONG = 72; // an expression longer than this gets a name of its own

class Emitter
{
  public:
    Emitter(const Graph &graph, Language language) : graph_(graph), language_(language) {}

    void count(const Expr &e)
    {
        if (!e.is_constant())
            count(e.id());
    }
    bool used(int id) const { return uses_.size() > static_cast<size_t>(id) && uses_[at(id)] > 0; }

    void emit_nodes();
    std::string text(const Expr &e) const
    {
        return e.is_constant() ? literal(e.value()) : texts_[at(e.id())].text;
    }
    std::string out;

  private:
    const Graph &graph_;
    Language language_;
    std::vector<int> uses_;
    std::vector<Text> texts_;
    int names_ = 0;

    static size_t at(int id) { return static_cast<size_t>(id); }
    void count(int id);
    Text write(const Node &n) const;
    std::string operand(int id, Binding least) const;
    void give_name(int id, const Node &n);
};

void Emitter::count(int id)
{
    if (id < 0)
        return;
    uses_.resize(at(graph_.size()), 0);
    if (uses_[at(id)]++ > 0)
        return;
    const Node &n = graph_[id];
    count(n.a);
    count(n.b);
    count(n.c);
}

std::string Emitter::operand(int id, Binding least) const
{
    const Text &t = texts_[at(id)];
    return t.binding < least ? "(" + t.text + ")" : t.text;
}

const char *function_name(Op op, Language language)
{
    switch (op) {
    case Op::Sin:
        return "sin";
    case Op::Cos:
        return "cos";
    case Op::Tanh:
        return "tanh";
    case Op::Exp:
        return "exp";
    case Op::Sqrt:
        return "sqrt";
    default:
        return language == Language::C ? "fabs" : "abs";
    }
}

// Parentheses keep the order in which the model computes: rounding stays the same.
Text Emitter::write(const Node &n) const
{
    switch (n.op) {
    case Op::Constant:
        return {literal(n.value), std::signbit(n.value) ? SIGN : ATOM};
    case Op::Variable:
        return {n.name, ATOM};
    case Op::Negate:
        return {"-" + operand(n.a, ATOM), SIGN};
    case Op::Add:
        return {operand(n.a, SUM) + " + " + operand(n.b, PRODUCT), SUM};
    case Op::Subtract:
        return {operand(n.a, SUM) + " - " + operand(n.b, PRODUCT), SUM};
    case Op::Multiply:
        return {operand(n.a, PRODUCT) + " * " + operand(n.b, ATOM), PRODUCT};
    case Op::Divide:
        return {operand(n.a, PRODUCT) + " / " + operand(n.b, ATOM), PRODUCT};
    case Op::IfPositive:
        return {operand(n.a, PRODUCT) + " > 0.0 ? " + operand(n.b, PRODUCT) + " : " +
                    operand(n.c, PRODUCT),
                SUM};
    default:
        return {std::string(function_name(n.op, language_)) + "(" + texts_[at(n.a)].text + ")",
                ATOM};
    }
}

void Emitter::give_name(int id, const Node &n)
{
    const std::string name = "w" + std::to_string(++names_), pad = indent(language_);
    if (n.op == Op::IfPositive && language_ == Language::Octave)
        out += pad + "if " + texts_[at(n.a)].text + " > 0\n" + pad + "  " + name + " = " +
               texts_[at(n.b)].text + ";\n" + pad + "else\n" + pad + "  " + name + " = " +
               texts_[at(n.c)].text + ";\n" + pad + "end\n";
    else
        out += pad + (language_ == Language::C ? "const double " : "") + name + " = " +
               texts_[at(id)].text + ";\n";
    texts_[at(id)] = {name, ATOM};
}

// Operands come before what is made of them, in the order of the graph.
void Emitter::emit_nodes()
{
    texts_.resize(at(graph_.size()));
    for (int id = 0; id < graph_.size(); id++) {
        if (!used(id))
            continue;
        const Node &n = graph_[id];
        texts_[at(id)] = write(n);
        bool leaf = n.op == Op::Constant || n.op == Op::Variable;
        if (!leaf &&
            (uses_[at(id)] > 1 || n.op == Op::IfPositive || texts_[at(id)].text.size() > LONG))
            give_name(id, n);
    }
}

} // namespace

std::string literal(double value)
{
    char text[MK_NUMBER_MAX];
    mk_format_double(text, value);
    std::string out = text;
    return std::strpbrk(text, ".einf") ? out : out + ".0";
}

std::string statements(const Graph &graph, Language language,
                       const std::vector<Assignment> &assignments)
{
    Emitter e(graph, language);
    for (const Assignment &a : assignments)
        e.count(a.value);
    e.emit_nodes();
    for (const Assignment &a : assignments)
        e.out += indent(language) + a.target + " = " + e.text(a.value) + ";\n";
    return e.out;
}

bool needs(const Graph &graph, const std::vector<Assignment> &assignments, const std::string &name)
{
    Emitter e(graph, Language::C);
    for (const Assignment &a : assignments)
        e.count(a.value);
    for (int id = 0; id < graph.size(); id++)
        if (graph[id].op == Op::Variable && graph[id].name == name && e.used(id))
            return true;
    return false;
}

} // namespace mk

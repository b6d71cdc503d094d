// A scalar that writes down what is computed with it. The laws of src/model are templates over
// their scalar: evaluated over Expr they leave a graph, and from it comes the same law as source
// text in another language. Equal subexpressions are one node, constants are folded.
//
// An Expr that is a plain constant belongs to no graph; a variable brings its graph along, so that
// nothing here is global.
#ifndef MECHKIT_EXCHANGE_EXPR_HPP
#define MECHKIT_EXCHANGE_EXPR_HPP

#include <cmath>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "model/scalar.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

enum class Op {
    Constant,
    Variable,
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Sin,
    Cos,
    Tanh,
    Exp,
    Sqrt,
    Abs,
    IfPositive // a > 0 ? b : c
};

struct Node {
    Op op;
    int a, b, c;      // operands, -1: none
    double value;     // of a constant; of a parameter when it was exported
    std::string name; // of a variable
};

class Graph
{
  public:
    int add(Op op, int a = -1, int b = -1, int c = -1);
    int constant(double value);
    int variable(const std::string &name, double value);
    const Node &operator[](int id) const { return nodes_[static_cast<size_t>(id)]; }
    int size() const { return static_cast<int>(nodes_.size()); }

  private:
    std::vector<Node> nodes_;
    std::map<std::tuple<Op, int, int, int>, int> known_;
    std::map<double, int> constants_;
    std::map<std::string, int> variables_;
};

class Expr
{
  public:
    Expr(double value = 0.0) : value_(value) {} // implicit: constants mix freely with variables
    Expr(Graph &graph, int id, double value) : graph_(&graph), id_(id), value_(value) {}
    static Expr variable(Graph &graph, const std::string &name, double value = NAN)
    {
        return {graph, graph.variable(name, value), value};
    }

    bool is_constant() const { return !graph_; }
    bool is(double value) const { return is_constant() && value_ == value; }
    // The number where it is known: of a constant or a parameter.
    double value() const { return value_; }
    Graph *graph() const { return graph_; }
    int id() const { return id_; } // -1: a constant
    // Place in a graph; a constant takes one there.
    int id_in(Graph &graph) const { return graph_ ? id_ : graph.constant(value_); }

    Expr operator-() const;
    Expr &operator+=(const Expr &b) { return *this = *this + b; }
    Expr &operator-=(const Expr &b) { return *this = *this - b; }
    Expr &operator*=(const Expr &b) { return *this = *this * b; }
    friend Expr operator+(const Expr &a, const Expr &b);
    friend Expr operator-(const Expr &a, const Expr &b);
    friend Expr operator*(const Expr &a, const Expr &b);
    friend Expr operator/(const Expr &a, const Expr &b);

  private:
    Graph *graph_ = nullptr;
    int id_ = -1;
    double value_;
};

Expr sin(const Expr &x);
Expr cos(const Expr &x);
Expr tanh(const Expr &x);
Expr exp(const Expr &x);
Expr sqrt(const Expr &x);
Expr fabs(const Expr &x);
Expr if_positive(const Expr &x, const Expr &a, const Expr &b);
inline void sincos(const Expr &x, Expr &s, Expr &c)
{
    s = sin(x);
    c = cos(x);
}
inline double value_of(const Expr &x)
{
    return x.value();
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif

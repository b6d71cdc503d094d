#include "exchange/expr.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

int Graph::add(Op op, int a, int b, int c)
{
    auto key = std::make_tuple(op, a, b, c);
    auto found = known_.find(key);
    if (found != known_.end())
        return found->second;
    nodes_.push_back({op, a, b, c, 0.0, ""});
    return known_[key] = size() - 1;
}

int Graph::constant(double value)
{
    auto found = constants_.find(value);
    if (found != constants_.end())
        return found->second;
    nodes_.push_back({Op::Constant, -1, -1, -1, value, ""});
    return constants_[value] = size() - 1;
}

int Graph::variable(const std::string &name, double value)
{
    auto found = variables_.find(name);
    if (found != variables_.end())
        return found->second;
    nodes_.push_back({Op::Variable, -1, -1, -1, value, name});
    return variables_[name] = size() - 1;
}

namespace
{

Expr made(Op op, const Expr &a)
{
    return {*a.graph(), a.graph()->add(op, a.id()), NAN};
}

Expr made(Op op, const Expr &a, const Expr &b)
{
    Graph &g = *(a.graph() ? a.graph() : b.graph());
    return {g, g.add(op, a.id_in(g), b.id_in(g)), NAN};
}

bool both_constant(const Expr &a, const Expr &b)
{
    return a.is_constant() && b.is_constant();
}

Expr function(Op op, double (*f)(double), const Expr &x)
{
    return x.is_constant() ? Expr(f(x.value())) : made(op, x);
}

} // namespace

Expr Expr::operator-() const
{
    if (is_constant())
        return Expr(-value_);
    const Node &n = (*graph_)[id_];
    if (n.op == Op::Negate)
        return {*graph_, n.a, NAN};
    return made(Op::Negate, *this);
}

Expr operator+(const Expr &a, const Expr &b)
{
    if (both_constant(a, b))
        return Expr(a.value() + b.value());
    if (a.is(0.0))
        return b;
    return b.is(0.0) ? a : made(Op::Add, a, b);
}

Expr operator-(const Expr &a, const Expr &b)
{
    if (both_constant(a, b))
        return Expr(a.value() - b.value());
    if (a.is(0.0))
        return -b;
    return b.is(0.0) ? a : made(Op::Subtract, a, b);
}

// A product with the constant zero is zero: models are evaluated where everything is finite.
Expr operator*(const Expr &a, const Expr &b)
{
    if (both_constant(a, b))
        return Expr(a.value() * b.value());
    if (a.is(0.0) || b.is(0.0))
        return Expr(0.0);
    if (a.is(1.0))
        return b;
    return b.is(1.0) ? a : made(Op::Multiply, a, b);
}

Expr operator/(const Expr &a, const Expr &b)
{
    if (both_constant(a, b))
        return Expr(a.value() / b.value());
    if (a.is(0.0))
        return Expr(0.0);
    return b.is(1.0) ? a : made(Op::Divide, a, b);
}

Expr sin(const Expr &x)
{
    return function(Op::Sin, ::sin, x);
}

Expr cos(const Expr &x)
{
    return function(Op::Cos, ::cos, x);
}

Expr tanh(const Expr &x)
{
    return function(Op::Tanh, ::tanh, x);
}

Expr exp(const Expr &x)
{
    return function(Op::Exp, ::exp, x);
}

Expr sqrt(const Expr &x)
{
    return function(Op::Sqrt, ::sqrt, x);
}

Expr fabs(const Expr &x)
{
    return function(Op::Abs, ::fabs, x);
}

Expr if_positive(const Expr &x, const Expr &a, const Expr &b)
{
    if (x.is_constant())
        return x.value() > 0.0 ? a : b;
    Graph &g = *x.graph();
    return {g, g.add(Op::IfPositive, x.id_in(g), a.id_in(g), b.id_in(g)), NAN};
}

} // namespace MK_KERNEL_NS
} // namespace mk

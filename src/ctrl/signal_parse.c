/* Recursive descent over
 *     sum     = product { (+|-) product }
 *     product = unary { (*|/) unary }
 *     unary   = - unary | + unary | power
 *     power   = primary [ ^ unary ]              right-associative, binds tighter than unary minus
 *     primary = number | t | pi | name ( args ) | ( sum )
 * emitting code for a stack machine. Nesting is bounded, and with it the recursion. */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "ctrl/signal_priv.h"
#include "mechkit/number.h"

struct parser {
    struct mk_signal *signal;
    const char *text, *at;
    struct mk_error *err;
    int depth, stack;
};

static enum mk_status parse_sum(struct parser *p);

static enum mk_status fail(struct parser *p, const char *where, const char *what)
{
    return mk_error_at(p->err, MK_ERR_PARSE, NULL, 0, (int)(where - p->text) + 1,
                       "%s at character %d of '%.80s'", what, (int)(where - p->text) + 1, p->text);
}

static void skip_blanks(struct parser *p)
{
    while (*p->at == ' ' || *p->at == '\t')
        p->at++;
}

/* Computes the last instruction, a function of `operands` values and not of t, if those are
 * numbers. In postfix order the operands of an instruction end just before it. */
static void fold(struct mk_signal *s, int operands)
{
    int first = s->count - 1 - operands;
    for (int i = first; i < s->count - 1; i++)
        if (s->code[i].op != OP_NUMBER)
            return;
    double value = mk_signal_execute(&s->code[first], operands + 1, 0.0);
    s->code[first] = (struct instruction){OP_NUMBER, 0, value};
    s->count = first + 1;
}

/* Appends an instruction that takes `operands` values off the stack and leaves one. */
static enum mk_status emit(struct parser *p, struct instruction in, int operands)
{
    if (p->signal->count == SIGNAL_MAX_OPS)
        return fail(p, p->at, "the expression is too long");
    p->stack += 1 - operands;
    if (p->stack > SIGNAL_MAX_DEPTH)
        return fail(p, p->at, "the expression is nested too deeply");
    p->signal->code[p->signal->count++] = in;
    bool timed = in.op == OP_TIME || (in.op == OP_CALL && mk_signal_functions[in.function].timed);
    if (operands > 0 && !timed)
        fold(p->signal, operands);
    return MK_OK;
}

static enum mk_status emit_number(struct parser *p, double value)
{
    return emit(p, (struct instruction){OP_NUMBER, 0, value}, 0);
}

static enum mk_status parse_number(struct parser *p)
{
    const char *from = p->at;
    while (isdigit((unsigned char)*p->at) || *p->at == '.')
        p->at++;
    if ((*p->at == 'e' || *p->at == 'E') &&
        (isdigit((unsigned char)p->at[1]) ||
         ((p->at[1] == '-' || p->at[1] == '+') && isdigit((unsigned char)p->at[2])))) {
        p->at += 2;
        while (isdigit((unsigned char)*p->at))
            p->at++;
    }
    double value;
    if (!mk_parse_double(from, p->at, &value))
        return fail(p, from, "this is not a number");
    if (!isfinite(value))
        return fail(p, from, "this number is too large");
    return emit_number(p, value);
}

static enum mk_status parse_arguments(struct parser *p, const struct signal_function *f, int index,
                                      const char *name_at)
{
    int n = 0;
    skip_blanks(p);
    if (*p->at != ')') {
        for (;;) {
            enum mk_status st = parse_sum(p);
            if (st != MK_OK)
                return st;
            n++;
            skip_blanks(p);
            if (*p->at != ',')
                break;
            p->at++;
        }
    }
    if (*p->at != ')')
        return fail(p, p->at, "expected ) or ,");
    p->at++;
    if (n != f->arguments)
        return mk_error_at(p->err, MK_ERR_PARSE, NULL, 0, (int)(name_at - p->text) + 1,
                           "%s takes %d arguments: %s", f->name, f->arguments, f->help);
    return emit(p, (struct instruction){OP_CALL, index, 0.0}, n);
}

static enum mk_status fail_function(struct parser *p, const char *from, size_t length)
{
    char word[40], text[120], hint[80];
    snprintf(word, sizeof word, "%.*s", (int)length, from);
    struct mk_meant meant = {.word = word};
    for (int i = 0; i < mk_signal_function_count; i++)
        mk_meant_try(&meant, mk_signal_functions[i].name);
    snprintf(text, sizeof text, "there is no such function%s",
             mk_meant_text(&meant, hint, sizeof hint));
    return fail(p, from, text);
}

static enum mk_status parse_name(struct parser *p)
{
    const char *from = p->at;
    while (isalnum((unsigned char)*p->at) || *p->at == '_')
        p->at++;
    size_t n = (size_t)(p->at - from);
    skip_blanks(p);
    if (*p->at == '(') {
        for (int i = 0; i < mk_signal_function_count; i++) {
            const struct signal_function *f = &mk_signal_functions[i];
            if (strlen(f->name) == n && strncmp(f->name, from, n) == 0) {
                p->at++;
                return parse_arguments(p, f, i, from);
            }
        }
        return fail_function(p, from, n);
    }
    if (n == 1 && *from == 't')
        return emit(p, (struct instruction){OP_TIME, 0, 0.0}, 0);
    if (n == 2 && strncmp(from, "pi", 2) == 0)
        return emit_number(p, M_PI);
    return fail(p, from, "unknown name: expected t, pi or a function");
}

static enum mk_status parse_primary(struct parser *p)
{
    skip_blanks(p);
    if (isdigit((unsigned char)*p->at) || *p->at == '.')
        return parse_number(p);
    if (isalpha((unsigned char)*p->at))
        return parse_name(p);
    if (*p->at != '(')
        return fail(p, p->at,
                    *p->at ? "expected a number, t, a function or (" : "the end is early");
    p->at++;
    enum mk_status st = parse_sum(p);
    if (st != MK_OK)
        return st;
    skip_blanks(p);
    if (*p->at != ')')
        return fail(p, p->at, "expected )");
    p->at++;
    return MK_OK;
}

static enum mk_status parse_unary(struct parser *p)
{
    skip_blanks(p);
    if (++p->depth > SIGNAL_MAX_DEPTH)
        return fail(p, p->at, "the expression is nested too deeply");
    enum mk_status st;
    if (*p->at == '-') {
        p->at++;
        st = parse_unary(p);
        if (st == MK_OK)
            st = emit(p, (struct instruction){OP_NEG, 0, 0.0}, 1);
    } else if (*p->at == '+') {
        p->at++;
        st = parse_unary(p);
    } else {
        st = parse_primary(p);
        skip_blanks(p);
        if (st == MK_OK && *p->at == '^') {
            p->at++;
            st = parse_unary(p);
            if (st == MK_OK)
                st = emit(p, (struct instruction){OP_POW, 0, 0.0}, 2);
        }
    }
    p->depth--;
    return st;
}

/* A left-associative chain of two operators over operands read by `next`. */
static enum mk_status parse_chain(struct parser *p, char first, enum op first_op, char second,
                                  enum op second_op, enum mk_status (*next)(struct parser *))
{
    enum mk_status st = next(p);
    while (st == MK_OK) {
        skip_blanks(p);
        char c = *p->at;
        if (c != first && c != second)
            break;
        p->at++;
        st = next(p);
        if (st == MK_OK)
            st = emit(p, (struct instruction){c == first ? first_op : second_op, 0, 0.0}, 2);
    }
    return st;
}

static enum mk_status parse_product(struct parser *p)
{
    return parse_chain(p, '*', OP_MUL, '/', OP_DIV, parse_unary);
}

static enum mk_status parse_sum(struct parser *p)
{
    if (++p->depth > SIGNAL_MAX_DEPTH)
        return fail(p, p->at, "the expression is nested too deeply");
    enum mk_status st = parse_chain(p, '+', OP_ADD, '-', OP_SUB, parse_product);
    p->depth--;
    return st;
}

enum mk_status mk_signal_parse(struct mk_signal *signal, const char *text, struct mk_error *err)
{
    struct parser p = {.signal = signal, .text = text, .at = text, .err = err};
    enum mk_status st = parse_sum(&p);
    if (st != MK_OK)
        return st;
    skip_blanks(&p);
    if (*p.at)
        return fail(&p, p.at, "expected an operator or the end");
    return MK_OK;
}

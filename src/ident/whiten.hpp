// Rows whose errors hang together over a few neighbours, made independent as they come: a banded
// block Cholesky factorisation that keeps no more than the band.
#ifndef MECHKIT_IDENT_WHITEN_HPP
#define MECHKIT_IDENT_WHITEN_HPP

#include <deque>
#include <vector>

#include "ident/regression.hpp"

namespace mk
{

class Whitener
{
  public:
    // One row more: its values (equations x anything) and its covariance with the rows before it,
    // nearest first, as far as there is any, then with itself. Returns the values of a row whose
    // error is independent of all before and of unit variance.
    Eigen::MatrixXd push(const Eigen::MatrixXd &values, const std::vector<Block> &before,
                         const Block &self);
    // What comes next has nothing to do with what was.
    void clear() { rows.clear(); }

  private:
    struct Row {
        std::vector<Block> factor; // with the rows before it, nearest first
        Block root;                // lower triangle
        Eigen::MatrixXd values;    // whitened
    };
    std::deque<Row> rows; // nearest first
};

} // namespace mk
#endif

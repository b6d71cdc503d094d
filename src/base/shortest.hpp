// The shortest decimal text of a double that reads back as the same double, by the Schubfach method
// (R. Giulietti, "The Schubfach way to render doubles", 2020), for numbers as logs have them: what
// is left of the method where all powers of ten that it needs are whole and exact in 128 bits.
//
// A double c 2^q is the nearest one to all that lies within half a step of it. With
//     k = floor(log10(width of that interval)) ,   s = floor(c 2^q / 10^k) ,
// at most one multiple of 10^(k+1), else s 10^k or (s + 1) 10^k, lies inside; the one inside, or
// the nearer one of two, is the shortest. Ends of the interval belong to it where c is even.
//
// Down to 1e-9 v = c 2^q / 10^k, with its fraction, is exact in 128 bits, and distances from v are
// compared. Below, all is compared in quarters of 10^k: 4 v and the ends of its interval are cut
// off to whole numbers whose last bit says that something was cut off (round to odd), which keeps
// every comparison with a multiple of two right.
#ifndef MECHKIT_BASE_SHORTEST_HPP
#define MECHKIT_BASE_SHORTEST_HPP

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace mk::shortest
{

__extension__ typedef unsigned __int128 Wide;

// 10^n as high 2^64 + low, shifted so that its first bit is the highest one.
struct Power {
    std::uint64_t high, low;
};
// 5^55 is the last power of five below 2^128.
constexpr int MOST_TENS = 55;

constexpr std::array<Power, MOST_TENS + 1> powers_of_ten()
{
    std::array<Power, MOST_TENS + 1> all{};
    Wide five = 1;
    for (std::size_t n = 0; n < all.size(); n++) {
        Wide shifted = five; // 10^n = 5^n 2^n: the same bits
        while (!(shifted >> 127))
            shifted <<= 1;
        all[n] = {static_cast<std::uint64_t>(shifted >> 64), static_cast<std::uint64_t>(shifted)};
        five *= 5;
    }
    return all;
}

inline constexpr auto TENS = powers_of_ten();

// Numbers that write() takes. Between these, k is within -MOST_TENS ... 0, and no number has more
// than 15 digits before its point.
constexpr double LEAST = 1e-30, MOST = 1e15;

inline bool takes(double value)
{
    return std::fabs(value) >= LEAST && std::fabs(value) < MOST;
}

// digits 10^exponent, digits within [10^16, 10^17).
struct Decimal {
    std::uint64_t digits;
    int exponent;
};

// The first 64 of the 192 bits of `power` times `factor`; the last of them is set where any bit
// behind it is.
inline std::uint64_t times(const Power &power, std::uint64_t factor)
{
    const Wide low = static_cast<Wide>(power.low) * factor;
    const Wide high =
        static_cast<Wide>(power.high) * factor + static_cast<std::uint64_t>(low >> 64);
    const std::uint64_t rest = static_cast<std::uint64_t>(high) | static_cast<std::uint64_t>(low);
    return static_cast<std::uint64_t>(high >> 64) | (rest != 0);
}

// What there is in the interval about v: s 10^k, (s + 1) 10^k and the multiples of 10^(k+1) around
// them.
struct Candidates {
    std::uint64_t s, tens; // tens = s / 10
    bool tens_inside, next_tens_inside, inside, next_inside;
    bool nearer; // s + 1 is nearer than s, or as near and even
};

// Up to this power of ten v = c W, with W = 2^q / 10^k below 16 in 2^60ths and a whole multiple of
// four: 5^25 has 59 bits. One product is v, and its fraction is exact.
constexpr int MOST_NARROW_TENS = 25;

// `log2_width`: floor(log2(2^q / 10^k)). Half the interval lies above v, a quarter below where
// doubles are closer there.
inline Candidates narrow_candidates(std::uint64_t c, const Power &ten, int log2_width, bool closer)
{
    constexpr std::uint64_t ONE = 1ull << 60;
    const std::uint64_t width = ten.high >> (3 - log2_width), odd = c & 1;
    const Wide v = static_cast<Wide>(c) * width;
    const std::uint64_t s = static_cast<std::uint64_t>(v >> 60), tens = s / 10;
    const std::uint64_t part = static_cast<std::uint64_t>(v) & (ONE - 1);
    const std::uint64_t from_tens = (s - 10 * tens) * ONE + part;
    const std::uint64_t below = (width >> (closer ? 2 : 1)) - odd, above = width / 2 - odd;
    const bool nearer = (part > ONE / 2) | ((part == ONE / 2) & (s & 1));
    return {s,
            tens,
            from_tens <= below,
            10 * ONE - from_tens <= above,
            part <= below,
            ONE - part <= above,
            nearer};
}

inline Candidates wide_candidates(std::uint64_t c, const Power &ten, int log2_width, bool closer)
{
    // Quarters of 10^k are made of the first 64 bits.
    const int shift = log2_width + 1;
    const std::uint64_t odd = c & 1, v = times(ten, 4 * c << shift),
                        lower = times(ten, (4 * c - 2 + closer) << shift) + odd,
                        upper = times(ten, (4 * c + 2) << shift) - odd;
    const std::uint64_t s = v / 4, tens = s / 10, middle = 4 * s + 2;
    const bool nearer = (v > middle) | ((v == middle) & (s & 1));
    return {s,
            tens,
            lower <= 40 * tens,
            40 * tens + 40 <= upper,
            lower <= 4 * s,
            4 * s + 4 <= upper,
            nearer};
}

// a or b; never by a branch.
inline std::uint64_t pick(bool first, std::uint64_t a, std::uint64_t b)
{
    return b ^ ((a ^ b) & -static_cast<std::uint64_t>(first));
}

// `bits`: of a normal double without its sign. Which of the candidates is inside is as good as
// random, so that a branch would be foreseen wrongly half of the time: all are computed, one is
// taken.
inline Decimal decimal_of(std::uint64_t bits)
{
    constexpr std::uint64_t HIDDEN = 1ull << 52, E16 = 10000000000000000;
    const std::uint64_t fraction = bits & (HIDDEN - 1), c = fraction | HIDDEN;
    const int q = static_cast<int>(bits >> 52) - 1075;
    // Below a power of two doubles are twice as dense: the interval is 3/4 as wide.
    const bool closer = fraction == 0;
    // floor(q log10(2)), or floor(q log10(2) + log10(3/4)), by fixed-point numbers.
    const int k = (q * 1262611 - (closer ? 524031 : 0)) >> 22;
    const Power &ten = TENS[static_cast<std::size_t>(-k)];
    const int log2_width = q + ((-k * 1741647) >> 19);
    const Candidates at = -k <= MOST_NARROW_TENS ? narrow_candidates(c, ten, log2_width, closer)
                                                 : wide_candidates(c, ten, log2_width, closer);
    const std::uint64_t usual = at.s + pick(at.inside != at.next_inside, at.next_inside, at.nearer);
    const std::uint64_t digits =
        pick(at.tens_inside != at.next_tens_inside, 10 * (at.tens + at.next_tens_inside), usual);
    // s = v / 10^k has 16 or 17 digits.
    const bool sixteen = digits < E16;
    return {pick(sixteen, 10 * digits, digits), k - sixteen};
}

// Eight digits as text, the first in the lowest byte, and how many zeros are at the end.
struct Eight {
    std::uint64_t text;
    int zeros;
};

// Of a number below 10^8. Lanes of one word are split side by side, from 8 digits into 4 and 4,
// into 2 and 2, into 1 and 1, the first of each in its lower half; quotients come by
// multiplication.
inline Eight eight_digits(std::uint64_t number)
{
    const std::uint64_t in_10000 = (number * 0x68db8bb) >> 40;
    const std::uint64_t fours = in_10000 + ((number - 10000 * in_10000) << 32);
    const std::uint64_t in_100 = ((fours * 0x147b) >> 19) & 0x7f0000007f;
    const std::uint64_t twos = in_100 + ((fours - 100 * in_100) << 16);
    const std::uint64_t in_10 = ((twos * 0x67) >> 10) & 0xf000f000f000f;
    const std::uint64_t ones = in_10 + ((twos - 10 * in_10) << 8);
    return {ones | 0x3030303030303030, ones ? __builtin_clzll(ones) / 8 : 8}; // '0' + each
}

inline void put(char *at, std::uint64_t text)
{
    constexpr bool FIRST_BYTE_IS_LOWEST = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
    if (!FIRST_BYTE_IS_LOWEST)
        text = __builtin_bswap64(text);
    std::memcpy(at, &text, sizeof text);
}
inline void put_16(char *at, Wide text)
{
    put(at, static_cast<std::uint64_t>(text));
    put(at + 8, static_cast<std::uint64_t>(text >> 64));
}

// Writes a number that takes() accepts and that is not whole, as std::to_chars would: without an
// exponent unless that is shorter. `at` has room for ROOM, since pieces of fixed length are stored;
// returns the end, MOST_TEXT further at most.
constexpr int ROOM = 48, MOST_TEXT = 24;

inline char *write(char *at, double value)
{
    constexpr std::uint64_t E8 = 100000000, ZEROS = 0x3030303030303030;
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    *at = '-';
    at += bits >> 63;
    const Decimal d = decimal_of(bits & ~(1ull << 63));
    // first . (8 digits) (8 digits) 10^scale
    const int scale = d.exponent + 16;
    const std::uint64_t nine = d.digits / E8, head = nine / E8;
    const char first = static_cast<char>('0' + head);
    const Eight middle = eight_digits(nine - head * E8), last = eight_digits(d.digits - nine * E8);
    const int count = 17 - last.zeros - (last.zeros == 8 ? middle.zeros : 0);
    const Wide behind = static_cast<Wide>(last.text) << 64 | middle.text;
    // 0.00123 takes one character more for each zero, 1.23e-03 four in all and a point of its own.
    const int zeros = scale < 0 ? -scale : 0;
    if (zeros > 3 + (count > 1)) {
        at[0] = first;
        at[1] = '.';
        put_16(at + 2, behind);
        at += count > 1 ? count + 1 : 1;
        at[0] = 'e';
        at[1] = '-';
        at[2] = static_cast<char>('0' + zeros / 10);
        at[3] = static_cast<char>('0' + zeros % 10);
        return at + 4;
    }
    // Which side of 1 a number is on is as good as random, so both sides go one way:
    //     12.345    first digits, point, digits behind it
    //     0.0012    zeros, first digit, point among the zeros, digits behind the first
    const int whole = scale < 0 ? 0 : scale;
    const Wide zeros_16 = static_cast<Wide>(ZEROS) << 64 | ZEROS;
    put_16(at, zeros > 0 ? zeros_16 : behind << 8);
    at[zeros + (zeros > 0)] = first;
    at[whole + 1] = '.';
    put_16(at + zeros + whole + 2, behind >> 8 * whole);
    return at + zeros + 1 + count;
}

} // namespace mk::shortest
#endif

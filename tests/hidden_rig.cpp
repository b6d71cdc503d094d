// A rig with something hidden in it behind the wire protocol: the tests' own simulator
// (support/truth.cpp, which shares no code with the models) where a board's electronics would be,
// and the board's own code (driver/device.c) before it. Over TCP, its clock may be stepped.
//
//     mechkit-hidden-rig --seed 7 --given given.ini --truth truth.json
//
// writes the textbook model of the rig that the seed draws, and the truth beside it, says where it
// listens, and serves one client at a time until it gets a signal.
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

// In C a struct and a function may share their name.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wshadow"
extern "C" {
#include "driver/device.h"
#include "driver/tcp.h"
}
#pragma GCC diagnostic pop
#include "mechkit/clock.h"
#include "support/cases.hpp"

namespace
{

constexpr int COUNTER_BITS = 24;

volatile std::sig_atomic_t stopped;

void on_signal(int)
{
    stopped = 1;
}

struct Options {
    truth::Wish wish;
    std::string given, truth, listen = "127.0.0.1:0";
    // Things that go wrong in a run (1-based; a run begins when the counters are zeroed), from a
    // time to another.
    struct Trouble {
        int run = 0;
        double from = 0.0, to = 0.0;
    } hand, loose;          // somebody holds the last joint; its encoder does not count
    int dead_motor_run = 0; // from which run on the amplifier gives nothing
};

// --- the board ---

class Board
{
  public:
    Board(const truth::Case &c, const Options &options_in)
        : hidden(c), options(options_in), rig(new_rig()), joints(truth::joints_of(c.rig.kind))
    {
        mk_clock_init_monotonic(&machine);
        opened_ns = mk_clock_now_ns(&machine);
        describe();
        mk_device_init(&device, &hal, &info);
    }
    // Bytes of the client; false: nobody is there any longer.
    bool take_in(int fd)
    {
        uint8_t bytes[4096];
        const ssize_t k = read(fd, bytes, sizeof bytes);
        if (k < 0)
            return errno == EAGAIN || errno == EINTR;
        live();
        if (k > 0)
            mk_device_receive(&device, bytes, (size_t)k);
        return k > 0;
    }
    // What falls due by itself, up to now.
    void live()
    {
        if (!held)
            run_to((uint64_t)(mk_clock_now_ns(&machine) - opened_ns));
        mk_device_poll(&device);
    }
    void hang_up()
    {
        live();
        mk_device_hang_up(&device);
        out.clear();
    }
    void send_out(int fd)
    {
        const ssize_t k = out.empty() ? 0 : send(fd, out.data(), out.size(), MSG_NOSIGNAL);
        if (k > 0)
            out.erase(out.begin(), out.begin() + k);
    }
    // Milliseconds that may be slept.
    int patience() const
    {
        const uint64_t event = mk_device_next_event(&device);
        if (held || event == UINT64_MAX)
            return 50;
        return event <= now ? 0 : (int)std::min<uint64_t>(50, (event - now) / 1000000);
    }
    double command() const { return u; }
    bool has_more() const { return !out.empty(); }

  private:
    const truth::Case &hidden;
    const Options &options;
    std::unique_ptr<truth::Live> rig;
    mk_device device = {};
    mk_device_hal hal = {};
    mk_device_info info = {};
    mk_clock machine;
    int64_t opened_ns;
    uint64_t now = 0; // of the board's clock
    bool held = false;
    double u = 0.0;
    int runs = 0, joints;
    uint64_t zeroed = 0; // when
    int32_t stuck = 0;   // what the loose encoder says
    long place[MK_WIRE_JOINTS] = {0, 0};
    std::vector<uint8_t> out;

    std::unique_ptr<truth::Live> new_rig() const
    {
        const truth::Recording &how = hidden.how[0];
        return std::make_unique<truth::Live>(hidden.rig, how.cpr, how.jitter, how.seed);
    }
    void run_to(uint64_t to)
    {
        while (now < to) {
            const uint64_t event = mk_device_next_event(&device);
            const uint64_t until = event > now && event < to ? event : to;
            rig->advance((double)(until - now) * 1e-9, u);
            now = until;
            if (until == event)
                mk_device_poll(&device);
        }
    }
    void hold_clock(bool hold)
    {
        held = hold;
        opened_ns = mk_clock_now_ns(&machine) - (int64_t)now;
        rig->begin();
        runs = 0;
        place[0] = place[1] = 0;
    }
    void zero()
    {
        // Where joints that rest anywhere are.
        int32_t moved[MK_WIRE_JOINTS];
        rig->counts(moved);
        for (int j = 0; j < MK_WIRE_JOINTS; j++)
            place[j] += moved[j];
        printf("zero: %ld %ld\n", place[0], place[1]);
        fflush(stdout);
        rig->zero();
        zeroed = now;
        stuck = 0;
        if (++runs == options.hand.run)
            rig->hold(joints, options.hand.from, options.hand.to);
    }
    bool is_loose() const
    {
        const double t = (double)(now - zeroed) * 1e-9;
        return runs == options.loose.run && t >= options.loose.from && t < options.loose.to;
    }
    void read_counters(int32_t *count)
    {
        int32_t seen[MK_WIRE_JOINTS];
        rig->counts(seen);
        if (is_loose())
            seen[joints - 1] = stuck;
        stuck = seen[joints - 1];
        for (int j = 0; j < MK_WIRE_JOINTS; j++) // as wide as the counter
            count[j] = (int32_t)((uint32_t)seen[j] << (32 - COUNTER_BITS)) >> (32 - COUNTER_BITS);
    }
    int32_t apply(int32_t micro)
    {
        const bool dead = options.dead_motor_run > 0 && runs >= options.dead_motor_run;
        u = dead ? 0.0 : (double)micro / MK_WIRE_MICRO;
        return micro; // who has no current sensor does not know
    }
    static Board *me(void *user) { return static_cast<Board *>(user); }
    void describe()
    {
        hal.user = this;
        hal.now_ns = [](void *user) { return me(user)->now; };
        hal.read_counters = [](void *user, int32_t *count) { me(user)->read_counters(count); };
        hal.zero_counters = [](void *user) { me(user)->zero(); };
        hal.apply = [](void *user, int32_t micro) { return me(user)->apply(micro); };
        hal.send = [](void *user, const uint8_t *bytes, size_t n) {
            me(user)->out.insert(me(user)->out.end(), bytes, bytes + n);
        };
        hal.step = [](void *user, uint64_t ns) {
            if (!me(user)->held)
                me(user)->hold_clock(true);
            me(user)->run_to(ns);
        };
        hal.run_freely = [](void *user) { me(user)->hold_clock(false); };
        snprintf(info.product, sizeof info.product, "hidden rig");
        snprintf(info.firmware, sizeof info.firmware, "1");
        info.counter_bits = COUNTER_BITS;
        info.encoders = (uint8_t)truth::joints_of(hidden.rig.kind);
        info.u_max_micro = (int32_t)std::lround(hidden.given.u_max * MK_WIRE_MICRO);
        for (int j = 0; j < MK_WIRE_JOINTS; j++)
            info.cpr[j] = (int32_t)hidden.how[0].cpr[j];
    }
};

// --- files ---

bool write_truth(const truth::Case &c, const std::string &path)
{
    FILE *f = fopen(path.c_str(), "w");
    if (!f)
        return false;
    const mk_plant_info *plant = mk_plant(c.given.plant);
    fprintf(f, "{\"rig\": \"%s\", \"kind\": \"%s\", \"parameters\": {", c.rig.kind.c_str(),
            c.kind.c_str());
    for (size_t i = 0; i < c.rig.p.size(); i++)
        fprintf(f, "%s\"%s\": %.17g", i ? ", " : "", plant->parameter[i].name, c.rig.p[i]);
    fprintf(f, "}, \"effects\": [");
    for (size_t i = 0; i < c.rig.effects.size(); i++) {
        const truth::Effect &e = c.rig.effects[i];
        fprintf(f, "%s{\"name\": \"%s\", \"joint\": %d, \"values\": {", i ? ", " : "",
                e.name.c_str(), e.joint);
        const char *sep = "";
        for (const auto &value : e.value) {
            fprintf(f, "%s\"%s\": %.9g", sep, value.first.c_str(), value.second);
            sep = ", ";
        }
        fprintf(f, "}, \"right\": [");
        for (size_t k = 0; i < c.right.size() && k < c.right[i].size(); k++)
            fprintf(f, "%s[\"%s\", %d]", k ? ", " : "", c.right[i][k].effect.c_str(),
                    c.right[i][k].joint);
        fprintf(f, "]}");
    }
    fprintf(f, "], \"jitter\": %g, \"cpr\": [%g, %g]}\n", c.how[0].jitter, c.how[0].cpr[0],
            c.how[0].cpr[1]);
    return fclose(f) == 0;
}

bool write_files(const truth::Case &c, const Options &o, mk_error *err)
{
    if (!o.given.empty() &&
        mk_model_write(o.given.c_str(), &c.given, "as a textbook has it", err) != MK_OK)
        return false;
    if (!o.truth.empty() && !write_truth(c, o.truth)) {
        mk_error_set(err, MK_ERR_IO, "cannot write %s", o.truth.c_str());
        return false;
    }
    return true;
}

// --- serving ---

void serve(Board &board, int listening)
{
    int client = -1;
    char peer[80];
    while (!stopped) {
        pollfd p[2] = {{client, (short)(board.has_more() ? POLLIN | POLLOUT : POLLIN), 0},
                       {listening, POLLIN, 0}};
        poll(p, 2, board.patience());
        board.live();
        if (client >= 0 && (p[0].revents & ~POLLOUT) && !board.take_in(client)) {
            const double before = board.command();
            board.hang_up();
            close(client);
            client = -1;
            printf("left: command %g, was %g\n", board.command(), before);
            fflush(stdout);
        }
        if (client >= 0)
            board.send_out(client);
        if (p[1].revents & POLLIN) {
            const int fd = mk_tcp_accept(listening, peer, sizeof peer);
            if (client >= 0 && fd >= 0)
                close(fd);
            else if (fd >= 0)
                client = fd;
        }
    }
    board.hang_up();
}

const char usage[] =
    "usage: mechkit-hidden-rig [--seed S] [--rig R] [--kind none|parameters|single|pair|off]\n"
    "                          [--effect E] [--joint J] [--size X] [--listen HOST:PORT]\n"
    "                          [--given FILE] [--truth FILE] [--hand RUN:FROM:TO]\n"
    "                          [--loose-encoder RUN:FROM:TO] [--dead-motor RUN]\n"
    "A rig with something hidden in it behind docs/protocol.md; the rig of a seed is always the\n"
    "same.\n";

bool parse_trouble(const std::string &value, Options::Trouble &out)
{
    return sscanf(value.c_str(), "%d:%lf:%lf", &out.run, &out.from, &out.to) == 3;
}

bool parse(int argc, char **argv, Options &o)
{
    for (int i = 1; i + 1 < argc; i += 2) {
        const std::string key = argv[i], value = argv[i + 1];
        if (key == "--seed")
            o.wish.seed = (uint64_t)atoll(value.c_str());
        else if (key == "--rig")
            o.wish.rig = value;
        else if (key == "--kind")
            o.wish.kind = value;
        else if (key == "--effect")
            o.wish.effect = value;
        else if (key == "--joint")
            o.wish.joint = atoi(value.c_str());
        else if (key == "--size")
            o.wish.size = atof(value.c_str());
        else if (key == "--listen")
            o.listen = value;
        else if (key == "--given")
            o.given = value;
        else if (key == "--truth")
            o.truth = value;
        else if (key == "--dead-motor")
            o.dead_motor_run = atoi(value.c_str());
        else if (!(key == "--hand" && parse_trouble(value, o.hand)) &&
                 !(key == "--loose-encoder" && parse_trouble(value, o.loose)))
            return false;
    }
    return argc % 2 == 1;
}

} // namespace

int main(int argc, char **argv)
{
    Options o;
    mk_error err = MK_ERROR_INIT;
    if (!parse(argc, argv, o)) {
        fputs(usage, stderr);
        return 2;
    }
    o.wish.logs = false;
    try {
        const truth::Case c = truth::make_case(o.wish);
        char bound[80];
        int listening = -1;
        if (!write_files(c, o, &err) ||
            mk_tcp_listen(o.listen.c_str(), &listening, bound, sizeof bound, &err) != MK_OK) {
            fprintf(stderr, "mechkit-hidden-rig: %s\n", err.message);
            return 1;
        }
        signal(SIGINT, on_signal);
        signal(SIGTERM, on_signal);
        Board board(c, o);
        printf("listening on %s: --board tcp --device %s\n", bound, bound);
        fflush(stdout);
        serve(board, listening);
        close(listening);
    } catch (const std::exception &e) {
        fprintf(stderr, "mechkit-hidden-rig: %s\n", e.what());
        return 2;
    }
    return 0;
}

/* Sweeps over several processes. Rank 0 has the journal and hands out runs; the others ask, compute
 * and send lines back. Without MPI there is one process. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "experiment/sweep_journal.h"
#include "experiment/sweep_work.h"

#ifdef MK_HAVE_MPI
#include <mpi.h>

#define TAG_RESULTS 1 /* lines of results; empty: only asks for work */
#define TAG_FAILED 2  /* a message: this rank gives up */
#define TAG_WORK 3    /* indices of runs; none: there is no more */
#endif

static bool under_mpirun(void)
{
    return getenv("OMPI_COMM_WORLD_SIZE") || getenv("PMI_SIZE") || getenv("PMIX_RANK");
}

#ifndef MK_HAVE_MPI

enum mk_status sweep_ranks_open(struct sweep_ranks *r, struct mk_error *err)
{
    *r = (struct sweep_ranks){0, 1, 1, 1};
    const char *size = getenv("OMPI_COMM_WORLD_SIZE");
    if (under_mpirun() && !(size && strcmp(size, "1") == 0))
        return mk_error_set(err, MK_ERR_NOTSUP,
                            "this mechkit was built without MPI: install libopenmpi-dev, `make`, "
                            "or run it without mpirun");
    return MK_OK;
}

void sweep_ranks_close(struct sweep_ranks *r)
{
    (void)r;
}

bool sweep_ranks_agree(struct sweep_ranks *r, bool fine, uint64_t fingerprint, int threads)
{
    (void)fingerprint;
    r->threads = threads;
    return fine;
}

void sweep_ranks_serve(const struct sweep_ranks *r, struct sweep_queue *q)
{
    (void)r, (void)q;
}

enum mk_status sweep_ranks_help(const struct sweep_ranks *r, const struct sweep *s, int threads,
                                struct mk_error *err)
{
    (void)r, (void)s, (void)threads, (void)err;
    return MK_OK;
}

#else

enum mk_status sweep_ranks_open(struct sweep_ranks *r, struct mk_error *err)
{
    *r = (struct sweep_ranks){0, 1, 1, 1};
    if (!under_mpirun())
        return MK_OK;
    int level = 0;
    if (MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &level) != MPI_SUCCESS ||
        level < MPI_THREAD_FUNNELED)
        return mk_error_set(err, MK_ERR_NOTSUP, "this MPI does not go together with threads");
    MPI_Comm here;
    MPI_Comm_rank(MPI_COMM_WORLD, &r->rank);
    MPI_Comm_size(MPI_COMM_WORLD, &r->count);
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &here);
    MPI_Comm_size(here, &r->local);
    MPI_Comm_free(&here);
    return MK_OK;
}

void sweep_ranks_close(struct sweep_ranks *r)
{
    int begun = 0;
    (void)r;
    MPI_Initialized(&begun);
    if (begun)
        MPI_Finalize();
}

bool sweep_ranks_agree(struct sweep_ranks *r, bool fine, uint64_t fingerprint, int threads)
{
    r->threads = threads;
    if (r->count == 1)
        return fine;
    /* The largest of x and of ~x: equal everywhere when they belong together. */
    uint64_t mine[4] = {fingerprint, ~fingerprint, !fine, (uint64_t)threads}, all[4];
    MPI_Allreduce(mine, all, 4, MPI_UINT64_T, MPI_MAX, MPI_COMM_WORLD);
    r->threads = (int)all[3];
    return all[2] == 0 && all[0] == ~all[1];
}

/* --- rank 0 --------------------------------------------------------------------------------- */

static void take_lines(struct sweep_queue *q, char *text)
{
    char *save = NULL;
    for (char *line = strtok_r(text, "\n", &save); line; line = strtok_r(NULL, "\n", &save)) {
        size_t index;
        int outcome;
        const char *columns;
        if (sweep_split(q->sweep, line, &index, &outcome, &columns))
            sweep_queue_put(q, index, outcome, columns);
        else
            sweep_queue_fail(q, MK_ERR_PROTO, "another process sent what is no result");
    }
}

/* Large pieces first, small ones at the end, so that all finish together. */
static size_t piece(struct sweep_queue *q, const struct sweep_ranks *r, size_t most)
{
    pthread_mutex_lock(&q->lock);
    size_t share = (q->count - q->next) / (size_t)(2 * r->count) + 1;
    pthread_mutex_unlock(&q->lock);
    return most < share ? most : share;
}

/* False: there was none left. */
static bool send_work(struct sweep_queue *q, const struct sweep_ranks *r, int to)
{
    size_t most = (size_t)q->sweep->kind->batch * (size_t)r->threads;
    size_t first, n = sweep_queue_take(q, piece(q, r, most), &first);
    uint64_t *index = malloc((n ? n : 1) * sizeof *index);
    if (!index) {
        sweep_queue_fail(q, MK_ERR_NOMEM, "no memory to hand out runs");
        n = 0;
    }
    for (size_t i = 0; i < n; i++)
        index[i] = q->todo[first + i];
    MPI_Send(index, (int)n, MPI_UINT64_T, to, TAG_WORK, MPI_COMM_WORLD);
    free(index);
    return n > 0;
}

/* One message: results, and the wish for more. True when its sender has ended. */
static bool answer(struct sweep_queue *q, const struct sweep_ranks *r, const MPI_Status *from)
{
    int size = 0;
    MPI_Get_count(from, MPI_CHAR, &size);
    char *text = calloc((size_t)size + 1, 1);
    if (!text)
        abort(); /* what was computed elsewhere cannot be taken in; the journal has the rest */
    MPI_Recv(text, size, MPI_CHAR, from->MPI_SOURCE, from->MPI_TAG, MPI_COMM_WORLD,
             MPI_STATUS_IGNORE);
    bool failed = from->MPI_TAG == TAG_FAILED;
    if (failed)
        sweep_queue_fail(q, MK_ERR_NUMERIC, text);
    else if (size > 0)
        take_lines(q, text);
    free(text);
    return failed || !send_work(q, r, from->MPI_SOURCE);
}

void sweep_ranks_serve(const struct sweep_ranks *r, struct sweep_queue *q)
{
    for (int left = r->count - 1; left > 0;) {
        int there = 0;
        MPI_Status from;
        MPI_Iprobe(MPI_ANY_SOURCE, MPI_ANY_TAG, MPI_COMM_WORLD, &there, &from);
        if (there)
            left -= answer(q, r, &from);
        else
            nanosleep(&(struct timespec){0, 500000}, NULL); /* the threads have the processors */
    }
}

/* --- the others ----------------------------------------------------------------------------- */

struct parcel {
    char *text;
    size_t size;
    FILE *file;
};

static enum mk_status pack(void *user, size_t index, int outcome, const char *text,
                           struct mk_error *err)
{
    char line[SWEEP_LINE + 64];
    struct parcel *p = user;
    sweep_line(line, sizeof line, index, outcome, text);
    return fputs(line, p->file) < 0 ? mk_error_set(err, MK_ERR_NOMEM, "no memory for results")
                                    : MK_OK;
}

/* Computes `count` runs and sends them. */
static enum mk_status do_piece(const struct sweep *s, const size_t *todo, size_t count, int threads,
                               struct mk_error *err)
{
    struct parcel p = {NULL, 0, NULL};
    struct sweep_queue q;
    struct sweep_team team;
    p.file = open_memstream(&p.text, &p.size);
    if (!p.file)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for results");
    sweep_queue_init(&q, s, todo, count, pack, &p);
    enum mk_status st = sweep_team_start(&team, &q, threads, err);
    if (st == MK_OK) {
        sweep_team_join(&team);
        st = q.status;
        if (err && st != MK_OK)
            *err = q.err;
    }
    sweep_queue_destroy(&q);
    if (fclose(p.file) != 0 && st == MK_OK)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for results");
    if (st == MK_OK)
        MPI_Send(p.text, (int)p.size, MPI_CHAR, 0, TAG_RESULTS, MPI_COMM_WORLD);
    free(p.text);
    return st;
}

enum mk_status sweep_ranks_help(const struct sweep_ranks *r, const struct sweep *s, int threads,
                                struct mk_error *err)
{
    enum mk_status st = MK_OK;
    size_t most = (size_t)s->kind->batch * (size_t)r->threads;
    uint64_t *index = malloc(most * sizeof *index);
    size_t *todo = malloc(most * sizeof *todo);
    if (!index || !todo)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for runs");
    else
        MPI_Send(NULL, 0, MPI_CHAR, 0, TAG_RESULTS, MPI_COMM_WORLD);
    while (st == MK_OK) {
        MPI_Status from;
        int n = 0;
        MPI_Recv(index, (int)most, MPI_UINT64_T, 0, TAG_WORK, MPI_COMM_WORLD, &from);
        MPI_Get_count(&from, MPI_UINT64_T, &n);
        if (n == 0)
            break;
        for (int i = 0; i < n; i++)
            todo[i] = (size_t)index[i];
        st = do_piece(s, todo, (size_t)n, threads, err);
    }
    if (st != MK_OK) {
        const char *why = err ? err->message : mk_strerror(st);
        MPI_Send(why, (int)strlen(why), MPI_CHAR, 0, TAG_FAILED, MPI_COMM_WORLD);
    }
    free(index);
    free(todo);
    return st;
}

#endif

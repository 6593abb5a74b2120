// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
/* Preloaded into a process, steps its wall clock: CLOCK_REALTIME is shifted by the seconds that stand, as a double, in
 * the file named by ATPID_CLOCK_STEP. Waits until an absolute time of that clock end when the shifted clock says so, as
 * the kernel does it after `date -s`: a wait that is under way while the clock is set back lasts longer by the step.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SLICE_NS 2000000L
#define SPURIOUS 2500 /* slices: 5 s */
#define EPOCH_S 1000000000L /* an absolute time beyond this is one of the wall clock: the steady one counts from the boot */

static const volatile double *step(void) {
    static const volatile double *page;
    static const double none;
    if (page) return page;
    const char *path = getenv("ATPID_CLOCK_STEP");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *mapped = file < 0 ? MAP_FAILED : mmap(NULL, sizeof *page, PROT_READ, MAP_SHARED, file, 0);
    if (file >= 0) close(file);
    return page = mapped == MAP_FAILED ? &none : mapped;
}

static struct timespec shifted(const struct timespec *time, double seconds) {
    struct timespec result = *time;
    result.tv_sec += (time_t)seconds; /* whole seconds: nanoseconds stay */
    return result;
}

int clock_gettime(clockid_t id, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int failed = real(id, now);
    if (!failed && (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE)) *now = shifted(now, *step());
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec wall;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &wall);
    now->tv_sec = wall.tv_sec;
    now->tv_usec = wall.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *result) {
    struct timespec wall;
    clock_gettime(CLOCK_REALTIME, &wall);
    if (result) *result = wall.tv_sec;
    return wall.tv_sec;
}

/* Whether `end` has come; else a real time a slice ahead, at which to look again. */
static int come(const struct timespec *end, struct timespec *slice) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (now.tv_sec > end->tv_sec || (now.tv_sec == end->tv_sec && now.tv_nsec >= end->tv_nsec)) return 1;
    *slice = shifted(&now, -*step());
    slice->tv_nsec += SLICE_NS;
    if (slice->tv_nsec >= 1000000000L) slice->tv_nsec -= 1000000000L, ++slice->tv_sec;
    return 0;
}

int pthread_cond_timedwait(pthread_cond_t *restrict cond, pthread_mutex_t *restrict mutex, const struct timespec *restrict end) {
    static int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    if (!real) real = (int (*)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *))dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    if (end->tv_sec < EPOCH_S) return real(cond, mutex, end);
    struct timespec slice;
    for (int k = 0;; k++) {
        if (come(end, &slice)) return ETIMEDOUT;
        /* A signal that is given without the mutex may fall between two slices, as it cannot into the kernel's wait:
         * a wait may also end without one, and whoever waits then looks. */
        if (k == SPURIOUS) return 0;
        int result = real(cond, mutex, &slice);
        if (result != ETIMEDOUT) return result;
    }
}

int pthread_cond_clockwait(pthread_cond_t *cond, pthread_mutex_t *mutex, clockid_t id, const struct timespec *end) {
    static int (*real)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);
    if (!real) real = (int (*)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *))dlsym(RTLD_NEXT, "pthread_cond_clockwait");
    return id == CLOCK_REALTIME ? pthread_cond_timedwait(cond, mutex, end) : real(cond, mutex, id, end);
}

int sem_timedwait(sem_t *restrict semaphore, const struct timespec *restrict end) {
    static int (*real)(sem_t *, const struct timespec *);
    if (!real) real = (int (*)(sem_t *, const struct timespec *))dlsym(RTLD_NEXT, "sem_timedwait");
    for (struct timespec slice;;) {
        if (come(end, &slice)) return errno = ETIMEDOUT, -1;
        if (real(semaphore, &slice) == 0) return 0;
        if (errno != ETIMEDOUT) return -1;
    }
}

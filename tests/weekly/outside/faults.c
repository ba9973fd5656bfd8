/* Preloaded library that fails one call by which a program writes files below a folder.
 *
 * Environment: OUTSIDE_ROOT, the folder; OUTSIDE_STATE, a file of 64-bit numbers that all processes
 * of the program share: faults so far, and calls so far of each kind in the order of `KINDS`;
 * OUTSIDE_CALL, the kind of call that fails; OUTSIDE_AT, its number, 0 for none; OUTSIDE_ERROR, its
 * errno, or 0 for a write of half the bytes.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#define MAX_FDS 4096
#define N_KINDS 6
static const char *KINDS[N_KINDS] = {"open", "write", "sync", "close", "rename", "mkdir"};
static struct state { long faults, calls[N_KINDS]; } *state;
static const char *root, *kind;
static long at, error;
static char is_inside_fd[MAX_FDS];

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name)

__attribute__((constructor)) static void start(void) {
    const char *path = getenv("OUTSIDE_STATE");
    root = getenv("OUTSIDE_ROOT");
    if (!path || !root) { root = NULL; return; }
    kind = getenv("OUTSIDE_CALL");
    at = atol(getenv("OUTSIDE_AT"));
    error = atol(getenv("OUTSIDE_ERROR"));
    int fd = open(path, O_RDWR);
    state = mmap(NULL, sizeof *state, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (fd < 0 || state == MAP_FAILED) abort();
    close(fd);
}

static int is_inside(int folder, const char *path) {
    char full[PATH_MAX], link[64];
    if (!root || !path) return 0;
    if (path[0] != '/') {
        ssize_t n = 0;
        if (folder == AT_FDCWD) { if (!getcwd(full, sizeof full)) return 0; n = strlen(full); }
        else {
            snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
            if ((n = readlink(link, full, sizeof full - 1)) < 0) return 0;
        }
        if (n + 1 + strlen(path) >= sizeof full) return 0;
        full[n] = '/';
        strcpy(full + n + 1, path);
        path = full;
    }
    size_t n = strlen(root);
    return !strncmp(path, root, n) && (path[n] == '/' || !path[n]);
}

/* Count a call; return 1 if it is the one that fails. */
static int fails(const char *call) {
    int index = 0;
    if (!state) return 0;
    while (strcmp(KINDS[index], call)) index++;
    if (__sync_add_and_fetch(&state->calls[index], 1) != at || strcmp(kind, call)) return 0;
    __sync_add_and_fetch(&state->faults, 1);
    errno = error;
    return 1;
}

static int opened(int fd, int flags, int inside) {
    if (fd >= 0 && fd < MAX_FDS) is_inside_fd[fd] = !inside ? 0 : flags & (O_WRONLY | O_RDWR) ? 2 : 1;
    return fd;
}

static int tracked(int fd) { return root && fd >= 0 && fd < MAX_FDS && is_inside_fd[fd] == 2; }

#define OPEN(name, parameters, folder) \
    int name parameters { \
        mode_t mode = 0; \
        if (flags & (O_CREAT | O_TMPFILE)) { va_list v; va_start(v, flags); mode = va_arg(v, mode_t); va_end(v); } \
        static int (*real)(int, const char *, int, ...); \
        if (!real) real = (int (*)(int, const char *, int, ...))dlsym(RTLD_NEXT, "openat"); \
        int inside = is_inside(folder, path); \
        if (inside && flags & (O_WRONLY | O_RDWR) && fails("open")) return -1; \
        return opened(real(folder, path, flags, mode), flags, inside); \
    }
OPEN(open, (const char *path, int flags, ...), AT_FDCWD)
OPEN(open64, (const char *path, int flags, ...), AT_FDCWD)
OPEN(openat, (int folder, const char *path, int flags, ...), folder)
OPEN(openat64, (int folder, const char *path, int flags, ...), folder)

/* Return the bytes to write, or -1. */
static ssize_t allowed(int fd, size_t n) {
    if (!tracked(fd) || !fails("write")) return n;
    return error || n < 2 ? (errno = error ? error : EINTR, -1) : (ssize_t)(n / 2);
}

ssize_t write(int fd, const void *data, size_t n) {
    REAL(ssize_t, write, int, const void *, size_t);
    ssize_t m = allowed(fd, n);
    return m < 0 ? -1 : real(fd, data, m);
}

ssize_t pwrite64(int fd, const void *data, size_t n, off_t offset) {
    REAL(ssize_t, pwrite64, int, const void *, size_t, off_t);
    ssize_t m = allowed(fd, n);
    return m < 0 ? -1 : real(fd, data, m, offset);
}

ssize_t pwrite(int fd, const void *data, size_t n, off_t offset) { return pwrite64(fd, data, n, offset); }

ssize_t writev(int fd, const struct iovec *parts, int n) {
    REAL(ssize_t, writev, int, const struct iovec *, int);
    return tracked(fd) && fails("write") ? (errno = error ? error : EINTR, -1) : real(fd, parts, n);
}

#define ON_FD(name) \
    int name(int fd) { REAL(int, name, int); return tracked(fd) && fails("sync") ? -1 : real(fd); }
ON_FD(fsync)
ON_FD(fdatasync)

int close(int fd) {
    REAL(int, close, int);
    int was = root && fd >= 0 && fd < MAX_FDS && is_inside_fd[fd];
    if (was) is_inside_fd[fd] = 0;
    int code = real(fd);
    return was && fails("close") ? -1 : code;
}

int rename(const char *from, const char *to) {
    REAL(int, rename, const char *, const char *);
    return is_inside(AT_FDCWD, to) && fails("rename") ? -1 : real(from, to);
}

int renameat(int a, const char *from, int b, const char *to) {
    REAL(int, renameat, int, const char *, int, const char *);
    return is_inside(b, to) && fails("rename") ? -1 : real(a, from, b, to);
}

int mkdir(const char *path, mode_t mode) {
    REAL(int, mkdir, const char *, mode_t);
    return is_inside(AT_FDCWD, path) && fails("mkdir") ? -1 : real(path, mode);
}

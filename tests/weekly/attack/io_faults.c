/* Preloaded library that counts, logs and fails the calls by which a process changes files.
 *
 * Only calls on paths below one folder count. `faults_arm` sets the folder and the fault; the
 * counters lie in memory that the caller shares with the parent process. Log lines are
 * "CALL<TAB>BYTES<TAB>PATH<TAB>SECOND PATH", written before the call for writes and removals and
 * after it for others. Calls of other libraries that bypass the symbols of libc are not seen.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum { NONE, FAIL_ONCE, FAIL_FROM, KILL, FULL };
#define MAX_FDS 4096

static struct shared { long calls, bytes, faults; } *shared;
static char root[PATH_MAX];
static size_t root_length;
static int mode, fault_errno, log_fd = -1;
static long fault_at;
static char *names[MAX_FDS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

void faults_arm(const char *folder, int kind, long at, int error, int log, void *memory) {
    strcpy(root, folder);
    root_length = strlen(root);
    shared = memory;
    shared->calls = shared->bytes = shared->faults = 0;
    fault_at = at, fault_errno = error, log_fd = log;
    mode = kind;
}

static const char *full_path(int folder, const char *path, char *buffer) {
    if (!path) return NULL;
    if (path[0] == '/') return path;
    if (folder == AT_FDCWD || folder < 0 || folder >= MAX_FDS || !names[folder]) return path;
    if (snprintf(buffer, PATH_MAX, "%s/%s", names[folder], path) >= PATH_MAX) return path;
    return buffer;
}

static int is_inside(const char *path) {
    return root_length && path && !strncmp(path, root, root_length)
        && (path[root_length] == '/' || !path[root_length]);
}

static const char *fd_name(int fd) {
    return root_length && fd >= 0 && fd < MAX_FDS ? names[fd] : NULL;
}

static void note(const char *call, size_t n, const char *path, const char *second) {
    if (log_fd < 0) return;
    char line[3 * PATH_MAX];
    int length = snprintf(line, sizeof line, "%s\t%zu\t%s\t%s\n", call, n, path,
                          second ? second : "");
    int saved = errno;
    REAL(ssize_t, "write", int, const void *, size_t);
    if (real(log_fd, line, length) != length) abort();
    errno = saved;
}

/* Count a call; return -1 if it must fail. */
static int fault(int is_write) {
    pthread_mutex_lock(&lock);
    long number = ++shared->calls;
    pthread_mutex_unlock(&lock);
    int hits = (mode == FAIL_ONCE && number == fault_at) || (mode == FAIL_FROM && number >= fault_at)
        || (mode == KILL && number == fault_at);
    if (mode == FULL && !is_write) return 0;
    if (!hits) return 0;
    shared->faults++;
    if (mode == KILL) {
        kill(getpid(), SIGKILL);
        pause();
    }
    errno = fault_errno;
    return -1;
}

/* Return how many of n bytes may be written; -1 if none. */
static ssize_t allow(size_t n) {
    if (fault(1)) return -1;
    pthread_mutex_lock(&lock);
    long left = fault_at - shared->bytes;
    if (mode == FULL && (long)n > left) {
        shared->faults++;
        n = left > 0 ? left : 0;
    }
    shared->bytes += n;
    pthread_mutex_unlock(&lock);
    if (!n && mode == FULL && shared->faults) {
        errno = ENOSPC;
        return -1;
    }
    return n;
}

static int opened(int fd, const char *path, int existed, int flags) {
    if (fd >= 0 && fd < MAX_FDS) {
        free(names[fd]);
        names[fd] = strdup(path);
        if (flags & O_CREAT && !existed) note("create", 0, path, NULL);
        else if (flags & O_TRUNC) note("write", 0, path, NULL);
    }
    return fd;
}

static int open_at(int folder, const char *path, int flags, mode_t permissions) {
    REAL(int, "openat", int, const char *, int, ...);
    char buffer[PATH_MAX];
    const char *full = full_path(folder, path, buffer);
    if (!is_inside(full)) {
        int fd = real(folder, path, flags, permissions);
        if (fd >= 0 && fd < MAX_FDS && names[fd]) { free(names[fd]); names[fd] = NULL; }
        return fd;
    }
    if (fault(0)) return -1;
    struct stat about;
    int existed = !fstatat(folder, path, &about, 0);
    return opened(real(folder, path, flags, permissions), full, existed, flags);
}

#define OPEN(name, folder_parameter, folder) \
    int name(folder_parameter const char *path, int flags, ...) { \
        mode_t permissions = 0; \
        if (flags & (O_CREAT | O_TMPFILE)) { \
            va_list rest; va_start(rest, flags); permissions = va_arg(rest, mode_t); va_end(rest); \
        } \
        return open_at(folder, path, flags, permissions); \
    }
#define FOLDER int folder,
OPEN(open, , AT_FDCWD)
OPEN(open64, , AT_FDCWD)
OPEN(openat, FOLDER, folder)
OPEN(openat64, FOLDER, folder)

int close(int fd) {
    REAL(int, "close", int);
    int fails = fd_name(fd) && fault(0), number = errno;
    if (fd >= 0 && fd < MAX_FDS && names[fd]) { free(names[fd]); names[fd] = NULL; }
    int code = real(fd);
    if (!fails) return code;
    errno = number;
    return -1;
}

ssize_t write(int fd, const void *data, size_t n) {
    REAL(ssize_t, "write", int, const void *, size_t);
    const char *name = fd_name(fd);
    if (!name) return real(fd, data, n);
    ssize_t allowed = allow(n);
    if (allowed < 0) return -1;
    note("write", allowed, name, NULL);
    return real(fd, data, allowed);
}

ssize_t pwrite64(int fd, const void *data, size_t n, off64_t at) {
    REAL(ssize_t, "pwrite64", int, const void *, size_t, off64_t);
    const char *name = fd_name(fd);
    if (!name) return real(fd, data, n, at);
    ssize_t allowed = allow(n);
    if (allowed < 0) return -1;
    note("write", allowed, name, NULL);
    return real(fd, data, allowed, at);
}

ssize_t pwrite(int fd, const void *data, size_t n, off_t at) { return pwrite64(fd, data, n, at); }

ssize_t sendfile64(int out, int in, off64_t *at, size_t n) {
    REAL(ssize_t, "sendfile64", int, int, off64_t *, size_t);
    const char *name = fd_name(out);
    if (!name) return real(out, in, at, n);
    if (fault(1)) return -1;
    note("write", n, name, NULL);
    return real(out, in, at, n);
}

ssize_t sendfile(int out, int in, off_t *at, size_t n) { return sendfile64(out, in, at, n); }

#define ON_FD(type, name, call, parameters, arguments) \
    type name parameters { \
        static type (*real) parameters; \
        if (!real) real = (type (*) parameters)dlsym(RTLD_NEXT, #name); \
        const char *path = fd_name(fd); \
        if (!path) return real arguments; \
        if (fault(0)) return -1; \
        type result = real arguments; \
        if (!result) note(call, 0, path, NULL); \
        return result; \
    }
ON_FD(int, fsync, "sync", (int fd), (fd))
ON_FD(int, fdatasync, "sync", (int fd), (fd))
ON_FD(int, ftruncate, "write", (int fd, off_t n), (fd, n))
ON_FD(int, ftruncate64, "write", (int fd, off64_t n), (fd, n))

#define ON_PATH(name, call, is_before, parameters, arguments, folder) \
    int name parameters { \
        static int (*real) parameters; \
        if (!real) real = (int (*) parameters)dlsym(RTLD_NEXT, #name); \
        char buffer[PATH_MAX]; \
        const char *full = full_path(folder, path, buffer); \
        if (!is_inside(full)) return real arguments; \
        if (fault(0)) return -1; \
        if (is_before && !faccessat(folder, path, F_OK, AT_SYMLINK_NOFOLLOW)) note(call, 0, full, NULL); \
        int result = real arguments; \
        if (!is_before && !result) note(call, 0, full, NULL); \
        return result; \
    }
ON_PATH(unlink, "unlink", 1, (const char *path), (path), AT_FDCWD)
ON_PATH(unlinkat, "unlink", 1, (int folder, const char *path, int flags), (folder, path, flags), folder)
ON_PATH(rmdir, "unlink", 1, (const char *path), (path), AT_FDCWD)
ON_PATH(mkdir, "mkdir", 0, (const char *path, mode_t m), (path, m), AT_FDCWD)
ON_PATH(mkdirat, "mkdir", 0, (int folder, const char *path, mode_t m), (folder, path, m), folder)
ON_PATH(chmod, "chmod", 0, (const char *path, mode_t m), (path, m), AT_FDCWD)
ON_PATH(fchmodat, "chmod", 0, (int folder, const char *path, mode_t m, int f), (folder, path, m, f), folder)

#define ON_TWO(name, call, parameters, arguments, from, to) \
    int name parameters { \
        static int (*real) parameters; \
        if (!real) real = (int (*) parameters)dlsym(RTLD_NEXT, #name); \
        char first[PATH_MAX], second[PATH_MAX]; \
        const char *source = full_path(from, a, first), *target = full_path(to, b, second); \
        if (!is_inside(target)) return real arguments; \
        if (fault(0)) return -1; \
        int result = real arguments; \
        if (!result) note(call, 0, target, source); \
        return result; \
    }
ON_TWO(rename, "rename", (const char *a, const char *b), (a, b), AT_FDCWD, AT_FDCWD)
ON_TWO(renameat, "rename", (int m, const char *a, int n, const char *b), (m, a, n, b), m, n)
ON_TWO(link, "link", (const char *a, const char *b), (a, b), AT_FDCWD, AT_FDCWD)
ON_TWO(linkat, "link", (int m, const char *a, int n, const char *b, int f), (m, a, n, b, f), m, n)

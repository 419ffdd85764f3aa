/* LD_PRELOAD: makes the n-th change of the disk below a folder fail, in whatever process it happens.

   SHIM_FOLDER  changes below it are counted
   SHIM_COUNTER file of 8 bytes, shared by all processes: how many there were
   SHIM_AT      the change that fails, 0 for none
   SHIM_KIND    ENOSPC (and every later one too: a full disk stays full), EIO (once) or kill (the whole process group,
                half of a write being done)
   SHIM_LOG     file that says which inodes were written ("w INODE") and which were brought to the disk ("s INODE"):
                what a power cut would take
   SHIM_TRACE   file that says what every change was: "N VERB PATH"

   A process that is forked from one that had none of these calls shim_begin() once it has set them, and shim_end() where
   its changes are to be neither counted nor made to fail from then on. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

static long *counter;
static long at;
static int log_fd = -1, trace_fd = -1;
static char folder[PATH_MAX], kind[16];

__attribute__((constructor)) void shim_begin(void) {
  const char *f = getenv("SHIM_FOLDER"), *c = getenv("SHIM_COUNTER"), *a = getenv("SHIM_AT"), *k = getenv("SHIM_KIND");
  if (!f || !c || !a || !k) return;
  int fd = open(c, O_RDWR);
  if (fd < 0) return;
  void *p = mmap(NULL, sizeof(long), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  close(fd);
  if (p == MAP_FAILED) return;
  snprintf(folder, sizeof folder, "%s", f);
  snprintf(kind, sizeof kind, "%s", k);
  at = atol(a);
  if (getenv("SHIM_LOG")) log_fd = open(getenv("SHIM_LOG"), O_WRONLY | O_APPEND | O_CLOEXEC);
  if (getenv("SHIM_TRACE")) trace_fd = open(getenv("SHIM_TRACE"), O_WRONLY | O_APPEND | O_CLOEXEC);
  counter = p;
}

void shim_end(void) { counter = NULL; }

static void note(char what, int fd) {
  struct stat st;
  char line[40];
  if (log_fd < 0 || fstat(fd, &st)) return;
  int n = snprintf(line, sizeof line, "%c %lu\n", what, (unsigned long)st.st_ino);
  if (syscall(SYS_write, log_fd, line, n) < 0) return;
}

static int below(const char *path) {
  size_t n = strlen(folder);
  return path && !strncmp(path, folder, n) && (path[n] == '/' || !path[n]);
}

static int below_fd(int fd) {
  char link[64], path[PATH_MAX];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(link, path, sizeof path - 1);
  if (n < 0) return 0;
  path[n] = 0;
  return below(path);
}

static int below_at(int dir, const char *path) {
  if (path && path[0] != '/' && dir != AT_FDCWD) return below_fd(dir);
  return below(path);
}

static void trace(long n, const char *verb, int fd, const char *path) {
  char link[64], place[PATH_MAX], line[PATH_MAX + 60];
  if (trace_fd < 0) return;
  if (!path) {
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, place, sizeof place - 1);
    place[n < 0 ? 0 : n] = 0;
    path = place;
  }
  int length = snprintf(line, sizeof line, "%ld %s %s\n", n, verb, path);
  if (syscall(SYS_write, trace_fd, line, length) < 0) return;
}

/* 0: go on; 1: die after this; -1: fail, errno set. The file is told by its handle or by its path. */
static int step(int ours, const char *verb, int fd, const char *path) {
  if (!counter || !ours) return 0;
  long n = __atomic_add_fetch(counter, 1, __ATOMIC_SEQ_CST);
  trace(n, verb, fd, path);
  if (!at || n < at) return 0;
  if (!strcmp(kind, "kill")) return 1;
  if (!strcmp(kind, "ENOSPC")) { errno = ENOSPC; return -1; }
  if (n > at) return 0;
  errno = EIO;
  return -1;
}

static void die(void) { kill(0, SIGKILL); for (;;) pause(); }

#define REAL(name) static __typeof__(name) *real; if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

#define WRITES(name, length, ...)                     \
  int ours = fd > 2 && below_fd(fd), s = step(ours, "write", fd, NULL);  \
  if (ours) note('w', fd);                            \
  if (s < 0) return -1;                               \
  if (s) { if (length > 1) __VA_ARGS__; die(); }

ssize_t write(int fd, const void *b, size_t n) {
  REAL(write);
  WRITES(write, n, real(fd, b, n / 2))
  return real(fd, b, n);
}
ssize_t pwrite(int fd, const void *b, size_t n, off_t o) {
  REAL(pwrite);
  WRITES(pwrite, n, real(fd, b, n / 2, o))
  return real(fd, b, n, o);
}
ssize_t pwrite64(int fd, const void *b, size_t n, off64_t o) {
  REAL(pwrite64);
  WRITES(pwrite64, n, real(fd, b, n / 2, o))
  return real(fd, b, n, o);
}
ssize_t writev(int fd, const struct iovec *v, int n) {
  REAL(writev);
  WRITES(writev, n, real(fd, v, n / 2))
  return real(fd, v, n);
}
size_t fwrite(const void *b, size_t size, size_t n, FILE *f) {
  REAL(fwrite);
  int fd = fileno(f), ours = fd > 2 && below_fd(fd), s = step(ours, "write", fd, NULL);
  if (ours) note('w', fd);
  if (s < 0) return 0;
  if (s) { real(b, size, n / 2, f); fflush(f); die(); }
  return real(b, size, n, f);
}

ssize_t sendfile(int fd, int from, off_t *o, size_t n) {
  REAL(sendfile);
  WRITES(sendfile, n, real(fd, from, o, n / 2))
  return real(fd, from, o, n);
}
ssize_t sendfile64(int fd, int from, off64_t *o, size_t n) {
  REAL(sendfile64);
  WRITES(sendfile64, n, real(fd, from, o, n / 2))
  return real(fd, from, o, n);
}

#define PLAIN(test, ...)           \
  int s = step(test, __VA_ARGS__); \
  if (s < 0) return -1;            \
  if (s) die();

#define SYNCS                \
  int done = real(fd);       \
  if (!done) note('s', fd);  \
  return done;

int fsync(int fd) { REAL(fsync); PLAIN(below_fd(fd), "fsync", fd, NULL) SYNCS }
int fdatasync(int fd) { REAL(fdatasync); PLAIN(below_fd(fd), "fsync", fd, NULL) SYNCS }
int ftruncate(int fd, off_t n) { REAL(ftruncate); PLAIN(below_fd(fd), "cut", fd, NULL) return real(fd, n); }
int ftruncate64(int fd, off64_t n) { REAL(ftruncate64); PLAIN(below_fd(fd), "cut", fd, NULL) return real(fd, n); }
int mkdir(const char *p, mode_t m) { REAL(mkdir); PLAIN(below(p), "mkdir", -1, p) return real(p, m); }
int mkdirat(int d, const char *p, mode_t m) { REAL(mkdirat); PLAIN(below_at(d, p), "mkdir", -1, p) return real(d, p, m); }
int rename(const char *a, const char *b) { REAL(rename); PLAIN(below(b), "rename", -1, b) return real(a, b); }
int renameat(int d, const char *a, int e, const char *b) {
  REAL(renameat);
  PLAIN(below_at(e, b), "rename", -1, b)
  return real(d, a, e, b);
}

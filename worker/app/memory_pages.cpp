// What jemalloc is told before main(): memory in huge pages where the system leaves that to
// programs (transparent_hugepage/enabled: madvise), see jemalloc(3), opt.thp.

extern "C" {
extern const char* malloc_conf;
const char* malloc_conf = "thp:always";
}

/* What a shared library shows to its callers. */
#ifndef EXPORTED_H
#define EXPORTED_H

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

#endif

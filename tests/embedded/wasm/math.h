/* The functions of libm that the library uses, as instructions of the machine. */
double sqrt(double x);
float sqrtf(float x);
#define sqrt(x) __builtin_sqrt(x)
#define sqrtf(x) __builtin_sqrtf(x)
#define NAN __builtin_nanf("")

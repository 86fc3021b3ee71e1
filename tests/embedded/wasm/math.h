/* What the library takes of libm, where there is none: an instruction of the machine. */
double sqrt(double x);
float sqrtf(float x);
#define sqrt(x) __builtin_sqrt(x)
#define sqrtf(x) __builtin_sqrtf(x)
#define NAN __builtin_nanf("")

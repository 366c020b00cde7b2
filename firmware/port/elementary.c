// The elementary functions of the core, translated from their Python source by the build.
#include <math.h>
#include "py/obj.h"
#include "py/runtime.h"

typedef mp_float_t real;
#define REAL_SQRT MICROPY_FLOAT_C_FUN(sqrt)
#define REAL_COPYSIGN MICROPY_FLOAT_C_FUN(copysign)
#include "elementary.h" // generated

MP_REGISTER_MODULE(MP_QSTR_elementary, elementary_module);

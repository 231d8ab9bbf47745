/* FMI 3.0 for co-simulation, around a model in C. The names and types are those of the standard. */

#include <stdbool.h>
#include <stdint.h>

#include "instance.h"

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef int fmi3Qualifier; /* of dependencies and intervals */
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3Callback)(void);

typedef struct {
    values v;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} instance;

static fmi3Status fail(void *c, const char *text)
{
    const instance *own = (const instance *)c;

    if (own != NULL && own->log != NULL) {
        own->log(own->environment, fmi3Error, "logStatusError", text);
    }
    return fmi3Error;
}

EXPORTED const char *fmi3GetVersion(void) { return "3.0"; }

EXPORTED fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n,
                                        const fmi3String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

EXPORTED fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3Callback update)
{
    instance *c;

    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early;
    (void)intermediate, (void)n, (void)update;
    c = (instance *)calloc(1, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    c->environment = environment;
    c->log = log;
    if (token == NULL || strcmp(token, TOKEN) != 0) {
        fail(c, "this is an FMU with the instantiation token " TOKEN);
        free(c);
        return NULL;
    }
    start_anew(&c->v);
    return c;
}

EXPORTED fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    if (log != NULL) {
        log(environment, fmi3Error, "logStatusError", "this is an FMU for co-simulation");
    }
    return NULL;
}

EXPORTED fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3Callback update, fmi3Callback lock, fmi3Callback unlock)
{
    (void)update, (void)lock, (void)unlock;
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

EXPORTED void fmi3FreeInstance(fmi3Instance c) { free(c); }

EXPORTED fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance,
                                                fmi3Float64 tolerance, fmi3Float64 start,
                                                fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)c, (void)has_tolerance, (void)tolerance, (void)start, (void)has_stop, (void)stop;
    return fmi3OK;
}

EXPORTED fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    begin_motion(&((instance *)c)->v);
    return fmi3OK;
}

EXPORTED fmi3Status fmi3Terminate(fmi3Instance c)
{
    (void)c;
    return fmi3OK;
}

EXPORTED fmi3Status fmi3Reset(fmi3Instance c)
{
    start_anew(&((instance *)c)->v);
    return fmi3OK;
}

EXPORTED fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                   fmi3Float64 value[], size_t count)
{
    instance *own = (instance *)c;
    int found = n == count;
    size_t i;

    if (!own->v.begun) { /* while it is initialised: as if it began now */
        begin_motion(&own->v);
        own->v.begun = 0;
    }
    for (i = 0; i < n && i < count; ++i) {
        if (vr[i] == TIME) {
            value[i] = own->v.time;
        } else {
            value[i] = get_value(&own->v, vr[i], &found);
        }
    }
    return found ? fmi3OK : fail(own, "no variable has this value reference");
}

EXPORTED fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                   const fmi3Float64 value[], size_t count)
{
    instance *own = (instance *)c;
    size_t i;

    for (i = 0; i < n && i < count; ++i) {
        if (!isfinite(value[i])) {
            return fail(own, "a value that is not finite");
        }
        if (!set_value(&own->v, vr[i], value[i])) {
            return fail(own, "no variable with this value reference can be set");
        }
    }
    return n == count ? fmi3OK : fail(own, "as many values as value references");
}

#define NONE_OF(kind, type)                                                                        \
    EXPORTED fmi3Status fmi3Get##kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n,     \
                                      type value[], size_t count)                                  \
    {                                                                                              \
        (void)vr, (void)value, (void)count;                                                        \
        return n == 0 ? fmi3OK : fail(c, "all variables are Float64");                             \
    }                                                                                              \
    EXPORTED fmi3Status fmi3Set##kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n,     \
                                      const type value[], size_t count)                            \
    {                                                                                              \
        (void)vr, (void)value, (void)count;                                                        \
        return n == 0 ? fmi3OK : fail(c, "all variables are Float64");                             \
    }

NONE_OF(Float32, float)
NONE_OF(Int8, int8_t)
NONE_OF(UInt8, uint8_t)
NONE_OF(Int16, int16_t)
NONE_OF(UInt16, uint16_t)
NONE_OF(Int32, int32_t)
NONE_OF(UInt32, uint32_t)
NONE_OF(Int64, int64_t)
NONE_OF(UInt64, uint64_t)
NONE_OF(Boolean, fmi3Boolean)
NONE_OF(String, fmi3String)

EXPORTED fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  size_t sizes[], fmi3Binary value[], size_t count)
{
    (void)vr, (void)sizes, (void)value, (void)count;
    return n == 0 ? fmi3OK : fail(c, "all variables are Float64");
}

EXPORTED fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  const size_t sizes[], const fmi3Binary value[], size_t count)
{
    (void)vr, (void)sizes, (void)value, (void)count;
    return n == 0 ? fmi3OK : fail(c, "all variables are Float64");
}

EXPORTED fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                 fmi3Boolean value[])
{
    (void)vr, (void)value;
    return n == 0 ? fmi3OK : fail(c, "there are no clocks");
}

EXPORTED fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                 const fmi3Boolean value[])
{
    (void)vr, (void)value;
    return n == 0 ? fmi3OK : fail(c, "there are no clocks");
}

EXPORTED fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    if (*state == NULL) {
        *state = calloc(1, sizeof(values));
    }
    if (*state == NULL) {
        return fail(c, "no memory for the state");
    }
    memcpy(*state, &((instance *)c)->v, sizeof(values));
    return fmi3OK;
}

EXPORTED fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    memcpy(&((instance *)c)->v, state, sizeof(values));
    return fmi3OK;
}

EXPORTED fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORTED fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(values);
    return fmi3OK;
}

EXPORTED fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[],
                                          size_t size)
{
    if (size < sizeof(values)) {
        return fail(c, "too little room for the state");
    }
    memcpy(bytes, state, sizeof(values));
    return fmi3OK;
}

EXPORTED fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                            fmi3FMUState *state)
{
    if (size != sizeof(values)) {
        return fail(c, "these bytes are no state of this model");
    }
    if (*state == NULL) {
        *state = calloc(1, sizeof(values));
    }
    if (*state == NULL) {
        return fail(c, "no memory for the state");
    }
    memcpy(*state, bytes, sizeof(values));
    return fmi3OK;
}

EXPORTED fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step,
                               fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *terminate,
                               fmi3Boolean *early, fmi3Float64 *reached)
{
    instance *own = (instance *)c;
    char text[160];
    int said = 0;

    (void)no_return;
    *event = *terminate = *early = false;
    *reached = time;
    if (step > 0.0) {
        said = go_on(&own->v, step);
    }
    if (said != 0) {
        tell_fault(text, sizeof text, said, step);
        return fail(c, text);
    }
    *reached = own->v.time = time + step;
    return fmi3OK;
}

/* What the standard asks every FMU to export, and this one has none of. */

#define LACKS(name, arguments)                                                                     \
    EXPORTED fmi3Status name arguments                                                             \
    {                                                                                              \
        return fail(c, "this FMU lacks " #name);                                                   \
    }
#define REFERENCES fmi3Instance c, const fmi3ValueReference *vr, size_t n

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

LACKS(fmi3GetNumberOfVariableDependencies, (fmi3Instance c, fmi3ValueReference vr, size_t *n))
LACKS(fmi3GetVariableDependencies,
      (fmi3Instance c, fmi3ValueReference vr, size_t *i, fmi3ValueReference *on, size_t *j,
       fmi3Qualifier *kinds, size_t n))
LACKS(fmi3GetDirectionalDerivative,
      (REFERENCES, const fmi3ValueReference *known, size_t m, const fmi3Float64 *seed, size_t s,
       fmi3Float64 *slopes, size_t count))
LACKS(fmi3GetAdjointDerivative,
      (REFERENCES, const fmi3ValueReference *known, size_t m, const fmi3Float64 *seed, size_t s,
       fmi3Float64 *slopes, size_t count))
LACKS(fmi3EnterConfigurationMode, (fmi3Instance c))
LACKS(fmi3ExitConfigurationMode, (fmi3Instance c))
LACKS(fmi3EnterEventMode, (fmi3Instance c))
LACKS(fmi3EnterStepMode, (fmi3Instance c))
LACKS(fmi3EnterContinuousTimeMode, (fmi3Instance c))
LACKS(fmi3GetIntervalDecimal, (REFERENCES, fmi3Float64 *intervals, fmi3Qualifier *kinds))
LACKS(fmi3GetIntervalFraction,
      (REFERENCES, uint64_t *counters, uint64_t *resolutions, fmi3Qualifier *kinds))
LACKS(fmi3GetShiftDecimal, (REFERENCES, fmi3Float64 *shifts))
LACKS(fmi3GetShiftFraction, (REFERENCES, uint64_t *counters, uint64_t *resolutions))
LACKS(fmi3SetIntervalDecimal, (REFERENCES, const fmi3Float64 *intervals))
LACKS(fmi3SetIntervalFraction, (REFERENCES, const uint64_t *counters, const uint64_t *resolutions))
LACKS(fmi3SetShiftDecimal, (REFERENCES, const fmi3Float64 *shifts))
LACKS(fmi3SetShiftFraction, (REFERENCES, const uint64_t *counters, const uint64_t *resolutions))
LACKS(fmi3EvaluateDiscreteStates, (fmi3Instance c))
LACKS(fmi3UpdateDiscreteStates,
      (fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
       fmi3Boolean *changed, fmi3Boolean *next, fmi3Float64 *time))
LACKS(fmi3CompletedIntegratorStep,
      (fmi3Instance c, fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *terminate))
LACKS(fmi3SetTime, (fmi3Instance c, fmi3Float64 time))
LACKS(fmi3SetContinuousStates, (fmi3Instance c, const fmi3Float64 *states, size_t n))
LACKS(fmi3GetContinuousStateDerivatives, (fmi3Instance c, fmi3Float64 *slopes, size_t n))
LACKS(fmi3GetEventIndicators, (fmi3Instance c, fmi3Float64 *indicators, size_t n))
LACKS(fmi3GetContinuousStates, (fmi3Instance c, fmi3Float64 *states, size_t n))
LACKS(fmi3GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 *nominals, size_t n))
LACKS(fmi3GetNumberOfEventIndicators, (fmi3Instance c, size_t *n))
LACKS(fmi3GetNumberOfContinuousStates, (fmi3Instance c, size_t *n))
LACKS(fmi3GetOutputDerivatives,
      (REFERENCES, const int32_t *orders, fmi3Float64 *slopes, size_t count))
LACKS(fmi3ActivateModelPartition,
      (fmi3Instance c, fmi3ValueReference clock, fmi3Float64 activation))

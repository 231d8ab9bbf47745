/* FMI 2.0 for co-simulation, around a model in C. The names and types are those of the standard. */

#include "instance.h"

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated }
    fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    values v;
    double time;
    const fmi2CallbackFunctions *callbacks;
    char name[128];
} instance;

static fmi2Status fail(instance *c, const char *text)
{
    if (c->callbacks != NULL && c->callbacks->logger != NULL) {
        c->callbacks->logger(c->callbacks->componentEnvironment, c->name, fmi2Error,
                             "logStatusError", "%s", text);
    }
    return fmi2Error;
}

EXPORTED const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORTED const char *fmi2GetVersion(void) { return "2.0"; }

EXPORTED fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                                        const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                                       fmi2String resources, const fmi2CallbackFunctions *callbacks,
                                       fmi2Boolean visible, fmi2Boolean logging)
{
    instance *c;

    (void)resources, (void)visible, (void)logging;
    c = (instance *)calloc(1, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    c->callbacks = callbacks;
    snprintf(c->name, sizeof c->name, "%s", name == NULL ? "" : name);
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, TOKEN) != 0) {
        fail(c, "this is an FMU for co-simulation with the guid " TOKEN);
        free(c);
        return NULL;
    }
    start_anew(&c->v);
    return c;
}

EXPORTED void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORTED fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance,
                                        fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop,
                                        fmi2Real stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((instance *)c)->time = start;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    begin_motion(&((instance *)c)->v);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2Reset(fmi2Component c)
{
    start_anew(&((instance *)c)->v);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                fmi2Real value[])
{
    instance *own = (instance *)c;
    int found = 1;
    size_t i;

    if (!own->v.begun) { /* while it is initialised: as if it began now */
        begin_motion(&own->v);
        own->v.begun = 0;
    }
    for (i = 0; i < n; ++i) {
        value[i] = get_value(&own->v, vr[i], &found);
    }
    return found ? fmi2OK : fail(own, "no variable has this value reference");
}

EXPORTED fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                const fmi2Real value[])
{
    instance *own = (instance *)c;
    size_t i;

    for (i = 0; i < n; ++i) {
        if (!isfinite(value[i])) {
            return fail(own, "a value that is not finite");
        }
        if (!set_value(&own->v, vr[i], value[i])) {
            return fail(own, "no variable with this value reference can be set");
        }
    }
    return fmi2OK;
}

#define NONE_OF(get, set, kind)                                                                    \
    EXPORTED fmi2Status get(fmi2Component c, const fmi2ValueReference vr[], size_t n,              \
                            kind value[])                                                          \
    {                                                                                              \
        (void)vr, (void)value;                                                                     \
        return n == 0 ? fmi2OK : fail((instance *)c, "all variables are real numbers");            \
    }                                                                                              \
    EXPORTED fmi2Status set(fmi2Component c, const fmi2ValueReference vr[], size_t n,              \
                            const kind value[])                                                    \
    {                                                                                              \
        (void)vr, (void)value;                                                                     \
        return n == 0 ? fmi2OK : fail((instance *)c, "all variables are real numbers");            \
    }

NONE_OF(fmi2GetInteger, fmi2SetInteger, fmi2Integer)
NONE_OF(fmi2GetBoolean, fmi2SetBoolean, fmi2Boolean)
NONE_OF(fmi2GetString, fmi2SetString, fmi2String)

EXPORTED fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (*state == NULL) {
        *state = calloc(1, sizeof(values));
    }
    if (*state == NULL) {
        return fail((instance *)c, "no memory for the state");
    }
    memcpy(*state, &((instance *)c)->v, sizeof(values));
    return fmi2OK;
}

EXPORTED fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    memcpy(&((instance *)c)->v, state, sizeof(values));
    return fmi2OK;
}

EXPORTED fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(values);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                          size_t size)
{
    if (size < sizeof(values)) {
        return fail((instance *)c, "too little room for the state");
    }
    memcpy(bytes, state, sizeof(values));
    return fmi2OK;
}

EXPORTED fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                            fmi2FMUstate *state)
{
    if (size != sizeof(values)) {
        return fail((instance *)c, "these bytes are no state of this model");
    }
    if (*state == NULL) {
        *state = calloc(1, sizeof(values));
    }
    if (*state == NULL) {
        return fail((instance *)c, "no memory for the state");
    }
    memcpy(*state, bytes, sizeof(values));
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference z[],
                                                 size_t nz, const fmi2ValueReference v[], size_t nv,
                                                 const fmi2Real dv[], fmi2Real dz[])
{
    (void)z, (void)nz, (void)v, (void)nv, (void)dv, (void)dz;
    return fail((instance *)c, "there are no directional derivatives");
}

EXPORTED fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                                size_t n, const fmi2Integer order[],
                                                const fmi2Real value[])
{
    instance *own = (instance *)c;
    size_t i;

    for (i = 0; i < n; ++i) {
        if (vr[i] >= FIRST_OUTPUT || order[i] != 1) {
            return fail(own, "inputs have derivatives of first order alone");
        }
        own->v.slope[vr[i]] = value[i];
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                                 size_t n, const fmi2Integer order[],
                                                 fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return fail((instance *)c, "outputs have no derivatives");
}

EXPORTED fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final)
{
    instance *own = (instance *)c;
    char text[160];
    int said;

    (void)final;
    if (step == 0.0) {
        return fmi2OK;
    }
    said = go_on(&own->v, step);
    own->time = time + step;
    if (said == 0) {
        return fmi2OK;
    }
    tell_fault(text, sizeof text, said, step);
    return fail(own, text);
}

EXPORTED fmi2Status fmi2CancelStep(fmi2Component c)
{
    return fail((instance *)c, "no step goes on by itself");
}

EXPORTED fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind, (void)value;
    (void)c;
    return fmi2Discard;
}

EXPORTED fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = ((instance *)c)->time;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind,
                                         fmi2Integer *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORTED fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind,
                                         fmi2Boolean *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORTED fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind,
                                        fmi2String *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

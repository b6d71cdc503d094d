// A model as an FMI 2.0 co-simulation unit: the C of source_c.cpp behind the standard's functions,
// and its description. Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0.
#include <set>

#include "exchange/source_text.hpp"
#include "mechkit/ident.h"

namespace mk
{
namespace
{

// Value references: inputs 0.., outputs 100.., parameters 200.., start values 300..; one boolean.
const char *const wrapper_text =
    R"(/* FMI 2.0 co-simulation of @NAME@. Written by mechkit @VERSION@. */
#include "@NAME@.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

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
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment environment;
} fmi2CallbackFunctions;

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define GUID "@GUID@"
enum { INPUT = 0, OUTPUT = 100, PARAMETER = 200, START = 300, INPUTS = @INPUTS@ };

struct unit {
    struct @NAME@ rig;
    double u[2], start[@UPPER@_STATES];
    int at_rest; /* effects start at rest, whatever their start values */
    int running; /* initialised: start values are taken */
    double t0;
    const fmi2CallbackFunctions *callbacks;
    fmi2String name;
};

static void restart(struct unit *m)
{
    double x[@UPPER@_STATES];
    memcpy(x, m->start, sizeof x);
    if (m->at_rest)
        @NAME@_at_rest(m->rig.p, m->start, m->start + @UPPER@_JOINTS, x);
    @NAME@_start_at(&m->rig, 0.0, x);
}

/* NULL: there is no such variable, or it cannot be written. */
static double *writable(struct unit *m, fmi2ValueReference r)
{
    if (r < INPUT + INPUTS)
        return &m->u[r - INPUT];
    if (r >= PARAMETER && r < PARAMETER + @UPPER@_PARAMETERS)
        return &m->rig.p[r - PARAMETER];
    if (r >= START && r < START + @UPPER@_STATES)
        return &m->start[r - START];
    return NULL;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                                     fmi2String resources, const fmi2CallbackFunctions *callbacks,
                                     fmi2Boolean visible, fmi2Boolean logging)
{
    static const double start[@UPPER@_STATES] = {@START@};
    (void)resources, (void)visible, (void)logging;
    struct unit *m = NULL;
    if (type == fmi2CoSimulation && guid && strcmp(guid, GUID) == 0)
        m = calloc(1, sizeof *m);
    if (!m) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->environment, name, fmi2Error, "logStatusError",
                              "this is a co-simulation unit with guid %s", GUID);
        return NULL;
    }
    @NAME@_init(&m->rig);
    memcpy(m->start, start, sizeof start);
    m->at_rest = 1;
    m->callbacks = callbacks;
    m->name = name;
    restart(m);
    return m;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String *s)
{
    (void)c, (void)on, (void)n, (void)s;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                      fmi2Real start, fmi2Boolean has_stop, fmi2Real stop)
{
    struct unit *m = c;
    (void)has_stop, (void)stop;
    m->t0 = start;
    if (has_tolerance && tolerance > 0.0 && tolerance < m->rig.rtol)
        m->rig.rtol = tolerance;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    restart(c);
    ((struct unit *)c)->running = 1;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component c)
{
    struct unit *m = c;
    static const double start[@UPPER@_STATES] = {@START@};
    @NAME@_init(&m->rig);
    memcpy(m->start, start, sizeof start);
    m->u[0] = m->u[1] = 0.0;
    m->at_rest = 1;
    m->running = 0;
    restart(m);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference *r, size_t n, fmi2Real *value)
{
    struct unit *m = c;
    double y[@UPPER@_JOINTS];
    if (!m->running)
        restart(m);
    @NAME@_measure(&m->rig, y);
    for (size_t i = 0; i < n; i++) {
        fmi2ValueReference k = r[i] - OUTPUT;
        double *known = writable(m, r[i]);
        if (known)
            value[i] = *known;
        else if (k < @UPPER@_JOINTS)
            value[i] = y[k];
        else if (k < @UPPER@_JOINTS + @UPPER@_STATES)
            value[i] = m->rig.x[k - @UPPER@_JOINTS];
        else
            return fmi2Error;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference *r, size_t n,
                              const fmi2Real *value)
{
    for (size_t i = 0; i < n; i++) {
        double *known = writable(c, r[i]);
        if (!known)
            return fmi2Error;
        *known = value[i];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference *r, size_t n,
                                 fmi2Boolean *value)
{
    for (size_t i = 0; i < n; i++) {
        if (r[i] != 0)
            return fmi2Error;
        value[i] = ((struct unit *)c)->at_rest;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference *r, size_t n,
                                 const fmi2Boolean *value)
{
    for (size_t i = 0; i < n; i++) {
        if (r[i] != 0)
            return fmi2Error;
        ((struct unit *)c)->at_rest = value[i] != 0;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real length, fmi2Boolean no_way_back)
{
    struct unit *m = c;
    (void)no_way_back;
    if (@NAME@_advance(&m->rig, now + length - m->t0, m->u) == 0)
        return fmi2OK;
    if (m->callbacks && m->callbacks->logger)
        m->callbacks->logger(m->callbacks->environment, m->name, fmi2Error, "logStatusError",
                             "the model leaves every bound after %g s", m->rig.t);
    return fmi2Error;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c)
{
    (void)c;
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real *value)
{
    struct unit *m = c;
    if (kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    *value = m->t0 + m->rig.t;
    return fmi2OK;
}

/* A state is a copy of the whole unit. */
EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (!*state)
        *state = malloc(sizeof(struct unit));
    if (!*state)
        return fmi2Error;
    memcpy(*state, c, sizeof(struct unit));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    memcpy(c, state, sizeof(struct unit));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* The rest of the interface: this unit has none of it. */
#define NOTHING(name, ...)                                                                        \
    EXPORT fmi2Status name(fmi2Component c, __VA_ARGS__);                                          \
    EXPORT fmi2Status name(fmi2Component c, __VA_ARGS__)
NOTHING(fmi2GetInteger, const fmi2ValueReference *r, size_t n, fmi2Integer *v)
{
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NOTHING(fmi2SetInteger, const fmi2ValueReference *r, size_t n, const fmi2Integer *v)
{
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NOTHING(fmi2GetString, const fmi2ValueReference *r, size_t n, fmi2String *v)
{
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NOTHING(fmi2SetString, const fmi2ValueReference *r, size_t n, const fmi2String *v)
{
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NOTHING(fmi2GetDirectionalDerivative, const fmi2ValueReference *u, size_t nu,
        const fmi2ValueReference *k, size_t nk, const fmi2Real *dk, fmi2Real *du)
{
    return (void)c, (void)u, (void)nu, (void)k, (void)nk, (void)dk, (void)du, fmi2Error;
}
NOTHING(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
{
    return (void)c, (void)s, (void)n, fmi2Error;
}
NOTHING(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte *b, size_t n)
{
    return (void)c, (void)s, (void)b, (void)n, fmi2Error;
}
NOTHING(fmi2DeSerializeFMUstate, const fmi2Byte *b, size_t n, fmi2FMUstate *s)
{
    return (void)c, (void)b, (void)n, (void)s, fmi2Error;
}
NOTHING(fmi2SetRealInputDerivatives, const fmi2ValueReference *r, size_t n, const fmi2Integer *o,
        const fmi2Real *v)
{
    return (void)c, (void)r, (void)n, (void)o, (void)v, fmi2Error;
}
NOTHING(fmi2GetRealOutputDerivatives, const fmi2ValueReference *r, size_t n, const fmi2Integer *o,
        fmi2Real *v)
{
    return (void)c, (void)r, (void)n, (void)o, (void)v, fmi2Error;
}
NOTHING(fmi2GetStatus, fmi2StatusKind k, fmi2Status *v)
{
    return (void)c, (void)k, (void)v, fmi2Discard;
}
NOTHING(fmi2GetIntegerStatus, fmi2StatusKind k, fmi2Integer *v)
{
    return (void)c, (void)k, (void)v, fmi2Discard;
}
NOTHING(fmi2GetBooleanStatus, fmi2StatusKind k, fmi2Boolean *v)
{
    return (void)c, (void)k, (void)v, fmi2Discard;
}
NOTHING(fmi2GetStringStatus, fmi2StatusKind k, fmi2String *v)
{
    return (void)c, (void)k, (void)v, fmi2Discard;
}
)";

const char *const description_text = R"(<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="@NAME@" guid="@GUID@"
    description="@WHAT@" generationTool="mechkit @VERSION@" variableNamingConvention="flat"
    numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="@NAME@" canHandleVariableCommunicationStepSize="true"
      canGetAndSetFMUstate="true" canBeInstantiatedOnlyOncePerProcess="false"
      needsExecutionTool="false" canNotUseMemoryManagementFunctions="true">
    <SourceFiles>
      <File name="@NAME@.c"/>
      <File name="@NAME@_fmu.c"/>
    </SourceFiles>
  </CoSimulation>
  <UnitDefinitions>
@UNITS@  </UnitDefinitions>
  <LogCategories>
    <Category name="logStatusError"/>
  </LogCategories>
  <DefaultExperiment startTime="0" stopTime="10" stepSize="0.002"/>
  <ModelVariables>
@VARIABLES@  </ModelVariables>
  <ModelStructure>
    <Outputs>
@OUTPUTS@    </Outputs>
    <InitialUnknowns>
@OUTPUTS@    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
)";

std::string escape(const std::string &text)
{
    std::string out;
    for (char c : text)
        out += c == '&'   ? "&amp;"
               : c == '<' ? "&lt;"
               : c == '>' ? "&gt;"
               : c == '"' ? "&quot;"
                          : std::string(1, c);
    return out;
}

// What tells this unit from others: a number made of its source.
std::string guid(const std::string &source)
{
    unsigned long long hash[2] = {14695981039346656037ULL, 1099511628211ULL};
    for (unsigned char c : source)
        for (unsigned long long &h : hash)
            h = (h ^ c) * 1099511628211ULL;
    char text[64];
    snprintf(text, sizeof text, "{%08llx-%04llx-%04llx-%04llx-%012llx}", hash[0] >> 32,
             (hash[0] >> 16) & 0xffff, hash[0] & 0xffff, hash[1] >> 48,
             hash[1] & 0xffffffffffffULL);
    return text;
}

class Variables
{
  public:
    std::string xml, outputs;
    std::set<std::string> units; // those that variables have
    void add(const std::string &name, int reference, const std::string &attributes,
             const std::string &type, const std::string &description, const std::string &unit = "")
    {
        count_++;
        std::string typed = type;
        const size_t real = typed.find("<Real");
        if (!unit.empty() && real != std::string::npos) {
            typed.insert(real + 5, " unit=\"" + escape(unit) + "\"");
            units.insert(unit);
        }
        xml += "    <ScalarVariable name=\"" + name + "\" valueReference=\"" +
               std::to_string(reference) + "\" " + attributes + " description=\"" +
               escape(description) + "\">" + typed + "</ScalarVariable>\n";
        if (attributes.find("output") != std::string::npos)
            outputs += "      <Unknown index=\"" + std::to_string(count_) + "\"/>\n";
    }

  private:
    int count_ = 0;
};

std::string real(double start)
{
    return "<Real start=\"" + literal(start) + "\"/>";
}

std::vector<double> start_state(const SymbolicModel &s)
{
    std::vector<double> x(static_cast<size_t>(s.states));
    double v[MK_MAX_JOINTS] = {0.0, 0.0};
    mk_model_initial_state(&s.model, s.plant->rest, v, x.data());
    return x;
}

void add_variables(const SymbolicModel &s, Variables &all)
{
    const char *fixed = "causality=\"parameter\" variability=\"fixed\" initial=\"exact\"";
    const char *output = "causality=\"output\" variability=\"continuous\" initial=\"calculated\"";
    const char *local = "causality=\"local\" variability=\"continuous\" initial=\"calculated\"";
    const char *torque = mk_model_unit(&s.model, -1, "N m");
    std::string input = "causality=\"input\" variability=\"continuous\"";
    all.add("u", 0, input, real(0.0),
            "command of the motor, in units of " + literal(s.model.u_to_torque) +
                (s.model.joint_linear[s.plant->motor_joint] ? " N" : " N m"),
            torque);
    if (s.two_inputs)
        all.add("u2", 1, input, real(0.0), "torque on joint 2, in the same units", torque);
    for (int j = 0; j < s.joints; j++)
        all.add("q" + std::to_string(j + 1), 100 + j, output, "<Real/>",
                "what the encoder of joint " + std::to_string(j + 1) + " reads",
                mk_model_unit(&s.model, j, "rad"));
    for (int i = 0; i < s.states; i++) {
        const std::string &name = s.state_names[static_cast<size_t>(i)];
        bool speed = i >= s.joints && i < 2 * s.joints;
        all.add(speed ? name : name + "_true", 100 + s.joints + i, speed ? output : local,
                "<Real/>", "state of the model",
                i < s.joints ? mk_model_unit(&s.model, i, "rad")
                : speed      ? mk_model_unit(&s.model, i - s.joints, "rad/s")
                             : "");
    }
    for (size_t i = 0; i < s.parameters.size(); i++) {
        const ExportedParameter &p = s.parameters[i];
        all.add(p.name, 200 + static_cast<int>(i), fixed, real(p.value), p.help, p.unit);
    }
    std::vector<double> start = start_state(s);
    for (size_t i = 0; i < start.size(); i++)
        all.add(s.state_names[i] + "_start", 300 + static_cast<int>(i), fixed, real(start[i]),
                "state at the start",
                i < static_cast<size_t>(s.joints)       ? "rad"
                : i < 2 * static_cast<size_t>(s.joints) ? "rad/s"
                                                        : "");
    all.add("effects_start_at_rest", 0, fixed, "<Boolean start=\"true\"/>",
            "states of effects start at rest, whatever their _start values");
}

std::vector<std::pair<std::string, std::string>> words(const SymbolicModel &s,
                                                       const std::string &name)
{
    std::string start;
    for (double x : start_state(s))
        start += (start.empty() ? "" : ", ") + literal(x);
    return {{"NAME", name},
            {"UPPER", upper(name)},
            {"WHAT", escape(describe(s))},
            {"VERSION", MK_VERSION},
            {"GUID", guid(c_source(s, name))},
            {"INPUTS", s.two_inputs ? "2" : "1"},
            {"START", start}};
}

} // namespace

std::string fmu_source(const SymbolicModel &s, const std::string &name)
{
    return fill(wrapper_text, words(s, name));
}

std::string fmu_description(const SymbolicModel &s, const std::string &name)
{
    Variables all;
    add_variables(s, all);
    auto with = words(s, name);
    with.push_back({"VARIABLES", all.xml});
    with.push_back({"OUTPUTS", all.outputs});
    std::string units;
    for (const std::string &unit : all.units)
        units += "    <Unit name=\"" + escape(unit) + "\"/>\n";
    with.push_back({"UNITS", units});
    return fill(description_text, with);
}

} // namespace mk

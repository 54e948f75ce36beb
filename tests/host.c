/* A small importer in C: runs the closed loop of an unpacked SSP and tests typical operations of importers, with the binaries of
 * one platform. It shares no code with the FMUs but the standard's header, and computes nothing itself, so that its results can
 * be compared between platforms to the last bit.
 *
 *     host STRUCTURE PLATFORM OUTPUT [ELEMENT.VARIABLE=VALUE ...]
 *
 * The folder of STRUCTURE, an .ssd file, holds every resources/NAME.fmu unpacked in resources/NAME. All outputs of all elements at
 * every step go to OUTPUT, Reals as hexadecimal bits. The settings are added to the SSP's own. */

/* The C library of Windows parses numbers with an error in the last bit; that of mingw does not. */
#define __USE_MINGW_ANSI_STDIO 1

#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#include <limits.h>
#endif

#include "fmi2.h"

#define STEP_S 1e-4
/* In the paper's scenario the controller uses the estimated parameters from 0.2 s on. */
#define STEPS 2500
/* Steps repeated from a saved state or after a reset. */
#define AGAIN 300

#define FUNCTIONS(X) \
    X(GetTypesPlatform) X(GetVersion) X(SetDebugLogging) X(Instantiate) X(FreeInstance) X(SetupExperiment) \
    X(EnterInitializationMode) X(ExitInitializationMode) X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean) \
    X(GetString) X(SetReal) X(SetInteger) X(SetBoolean) X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) \
    X(SerializedFMUstateSize) X(SerializeFMUstate) X(DeSerializeFMUstate) X(GetDirectionalDerivative) \
    X(SetRealInputDerivatives) X(GetRealOutputDerivatives) X(DoStep) X(CancelStep) X(GetStatus) X(GetRealStatus) \
    X(GetIntegerStatus) X(GetBooleanStatus) X(GetStringStatus)

/* ---- Checks ---- */

static int passed, failed;

static void check(int holds, const char *what, ...)
{
    va_list arguments;
    if (holds) {
        passed++;
        return;
    }
    failed++;
    va_start(arguments, what);
    printf("FAILED: ");
    vprintf(what, arguments);
    printf("\n");
    va_end(arguments);
}

static void fail(const char *what, ...)
{
    va_list arguments;
    va_start(arguments, what);
    fprintf(stderr, "error: ");
    vfprintf(stderr, what, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
    exit(2);
}

/* ---- Texts ---- */

static char *text(const char *format, ...)
{
    va_list arguments;
    char *made = malloc(4096);
    int length;
    va_start(arguments, format);
    length = vsnprintf(made, 4096, format, arguments);
    va_end(arguments);
    if (length < 0 || length >= 4096)
        fail("a text is too long: %s", made);
    return made;
}

static char *read_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    char *content;
    long size;
    if (!file)
        fail("%s: %s", path, strerror(errno));
    fseek(file, 0, SEEK_END);
    size = ftell(file);
    rewind(file);
    content = calloc(1, (size_t)size + 1);
    if (fread(content, 1, (size_t)size, file) != (size_t)size)
        fail("%s: cannot be read", path);
    fclose(file);
    return content;
}

/* The next tag of that name, or null. The files of this project contain no comments that look like tags. */
static const char *find_tag(const char *from, const char *name)
{
    size_t length = strlen(name);
    for (from = strchr(from, '<'); from; from = strchr(from + 1, '<'))
        if (!strncmp(from + 1, name, length) && strchr(" />", from[1 + length]))
            return from + 1;
    return NULL;
}

/* The value of an attribute of a tag. */
static char *attribute(const char *tag, const char *name)
{
    char *key = text(" %s=\"", name), *value;
    const char *end = strchr(tag, '>'), *found = strstr(tag, key), *quote;
    if (!found || found > end)
        fail("no attribute %s in %.80s", name, tag);
    found += strlen(key);
    quote = strchr(found, '"');
    value = text("%.*s", (int)(quote - found), found);
    if (strchr(value, '&'))
        fail("this importer decodes no %s", value);
    free(key);
    return value;
}

static int is(const char *tag, const char *name, const char *wanted)
{
    char *value = attribute(tag, name);
    int same = !strcmp(value, wanted);
    free(value);
    return same;
}

/* ---- FMUs ---- */

typedef struct {
    char *name;
    fmi2ValueReference reference;
    char type; /* R, I (and enumerations), B or S */
    int is_output;
} Variable;

typedef struct {
    fmi2Status status;
    int count;
    char category[64], instance[512], message[4096];
} LogRecord;

typedef struct {
    char *name, *model, *guid, *resources, *path;
    int keeps_states, serializes_states;
    Variable *variables;
    int count;
    LogRecord logged;
    fmi2CallbackFunctions callbacks;
    fmi2Component component;
    void *library;
#define MEMBER(name) fmi2##name##TYPE *name;
    FUNCTIONS(MEMBER)
} Fmu;

typedef struct {
    Fmu *fmu;
    Variable *variable;
} End;

static Fmu fmus[8];
static int fmu_count;
static End wires[256][2];
static int wire_count;
static char *settings[256][2];
static int setting_count;

static void logger(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    LogRecord *logged = environment;
    va_list arguments;
    logged->count++;
    logged->status = status;
    snprintf(logged->instance, sizeof logged->instance, "%s", instance);
    snprintf(logged->category, sizeof logged->category, "%s", category ? category : "null");
    va_start(arguments, message);
    vsnprintf(logged->message, sizeof logged->message, message, arguments);
    va_end(arguments);
}

static void *open_library(const char *path)
{
#ifdef _WIN32
    void *library = (void *)LoadLibraryA(path);
    if (!library)
        fail("%s: error %lu", path, GetLastError());
#else
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library)
        fail("%s", dlerror());
#endif
    return library;
}

static void *symbol(void *library, const char *name)
{
#ifdef _WIN32
    return (void *)GetProcAddress((HMODULE)library, name);
#else
    return dlsym(library, name);
#endif
}

static int close_library(void *library)
{
#ifdef _WIN32
    return FreeLibrary((HMODULE)library) != 0;
#else
    return dlclose(library) == 0;
#endif
}

/* The absolute path, with slashes. */
static char *absolute(const char *path)
{
    char *full = malloc(4096), *at;
#ifdef _WIN32
    if (!GetFullPathNameA(path, 4096, full, NULL))
        fail("%s: error %lu", path, GetLastError());
#else
    if (!realpath(path, full))
        fail("%s: %s", path, strerror(errno));
#endif
    for (at = full; *at; at++)
        if (*at == '\\')
            *at = '/';
    return full;
}

/* The URL of a path: three slashes before `C:/...` as before `home/...`, blanks as %20. */
static char *url(const char *path)
{
    char *made = text("file://%s", *path == '/' ? "" : "/"), *at = made + strlen(made);
    made = realloc(made, strlen(made) + 3 * strlen(path) + 1);
    at = made + strlen(made);
    for (; *path; path++)
        at += sprintf(at, *path == ' ' ? "%%20" : "%c", *path);
    return made;
}

static Variable *find_variable(Fmu *fmu, const char *name)
{
    int i;
    for (i = 0; i < fmu->count; i++)
        if (!strcmp(fmu->variables[i].name, name))
            return &fmu->variables[i];
    fail("%s has no variable %s", fmu->model, name);
    return NULL;
}

static Fmu *find_fmu(const char *name)
{
    int i;
    for (i = 0; i < fmu_count; i++)
        if (!strcmp(fmus[i].name, name))
            return &fmus[i];
    fail("there is no element %s", name);
    return NULL;
}

static void load(Fmu *fmu, const char *folder, const char *platform)
{
    const char *ending = strstr(platform, "win") == platform ? "dll" : "so";
    char *description = read_file(text("%s/resources/%s/modelDescription.xml", folder, fmu->model));
    const char *tag = find_tag(description, "fmiModelDescription");
    fmu->resources = absolute(text("%s/resources/%s", folder, fmu->model));
    fmu->guid = attribute(tag, "guid");
    tag = find_tag(tag, "CoSimulation");
    fmu->keeps_states = is(tag, "canGetAndSetFMUstate", "true");
    fmu->serializes_states = is(tag, "canSerializeFMUstate", "true");
    for (tag = find_tag(tag, "ScalarVariable"); tag; tag = find_tag(tag, "ScalarVariable")) {
        Variable *variable;
        fmu->variables = realloc(fmu->variables, sizeof(Variable) * (size_t)(fmu->count + 1));
        variable = &fmu->variables[fmu->count++];
        variable->name = attribute(tag, "name");
        variable->reference = (fmi2ValueReference)strtoul(attribute(tag, "valueReference"), NULL, 10);
        variable->is_output = is(tag, "causality", "output");
        tag = strchr(tag, '<') + 1;
        variable->type = *tag == 'E' ? 'I' : *tag;
    }
    fmu->path = absolute(text("%s/resources/%s/binaries/%s/%s.%s", folder, fmu->model, platform, fmu->model, ending));
    fmu->library = open_library(fmu->path);
#define RESOLVE(name) \
    *(void **)&fmu->name = symbol(fmu->library, "fmi2" #name); \
    check(fmu->name != NULL, "%s: fmi2" #name " is not exported", fmu->model); \
    if (!fmu->name) \
        fail("nothing can be tried without fmi2" #name);
    FUNCTIONS(RESOLVE)
    fmu->callbacks.logger = logger;
    fmu->callbacks.componentEnvironment = &fmu->logged;
}

/* The parameter sets of a structure. One bound within an element names variables of that element, one bound
 * before all elements names elements and variables. */
static void read_parameters(const char *structure, const char *folder)
{
    const char *binding, *tag, *component;
    for (binding = find_tag(structure, "ssd:ParameterBinding"); binding;
         binding = find_tag(binding, "ssd:ParameterBinding")) {
        char *parameters = read_file(text("%s/%s", folder, attribute(binding, "source"))), *prefix = "";
        for (component = find_tag(structure, "ssd:Component"); component && component < binding;
             component = find_tag(component, "ssd:Component"))
            prefix = text("%s.", attribute(component, "name"));
        for (tag = find_tag(parameters, "ssv:Parameter"); tag; tag = find_tag(tag, "ssv:Parameter")) {
            settings[setting_count][0] = text("%s%s", prefix, attribute(tag, "name"));
            settings[setting_count++][1] = attribute(strchr(tag, '<') + 1, "value");
        }
    }
}

static void read_structure(const char *path, const char *platform)
{
    char *structure = read_file(path), *folder = absolute(path);
    const char *tag;
    *strrchr(folder, '/') = 0;
    for (tag = find_tag(structure, "ssd:Component"); tag; tag = find_tag(tag, "ssd:Component")) {
        Fmu *fmu = &fmus[fmu_count++];
        char *source = attribute(tag, "source");
        fmu->name = attribute(tag, "name");
        source[strlen(source) - strlen(".fmu")] = 0;
        fmu->model = source + strlen("resources/");
        load(fmu, folder, platform);
    }
    for (tag = find_tag(structure, "ssd:Connection"); tag; tag = find_tag(tag, "ssd:Connection")) {
        End *ends = wires[wire_count++];
        ends[0].fmu = find_fmu(attribute(tag, "startElement"));
        ends[0].variable = find_variable(ends[0].fmu, attribute(tag, "startConnector"));
        ends[1].fmu = find_fmu(attribute(tag, "endElement"));
        ends[1].variable = find_variable(ends[1].fmu, attribute(tag, "endConnector"));
        if (ends[0].variable->type != ends[1].variable->type)
            fail("this importer converts no types");
    }
    read_parameters(structure, folder);
    if (fmu_count != 3 || !wire_count || !setting_count)
        fail("%s has %d elements, %d connections, %d parameters", path, fmu_count, wire_count, setting_count);
}

/* ---- The loop ---- */

static void set(Fmu *fmu, const char *name, const char *value)
{
    Variable *variable = find_variable(fmu, name);
    fmi2Real real = strtod(value, NULL);
    fmi2Integer integer = variable->type == 'B' ? !strcmp(value, "true") : (fmi2Integer)strtol(value, NULL, 10);
    fmi2Status status = variable->type == 'R'   ? fmu->SetReal(fmu->component, &variable->reference, 1, &real)
                        : variable->type == 'I' ? fmu->SetInteger(fmu->component, &variable->reference, 1, &integer)
                                                : fmu->SetBoolean(fmu->component, &variable->reference, 1, &integer);
    check(status == fmi2OK, "%s.%s = %s is refused: %s", fmu->name, name, value, fmu->logged.message);
}

static void instantiate(void)
{
    int i;
    for (i = 0; i < fmu_count; i++) {
        Fmu *fmu = &fmus[i];
        char *place = text("%s/resources", url(fmu->resources));
        fmu->component =
            fmu->Instantiate(fmu->name, fmi2CoSimulation, fmu->guid, place, &fmu->callbacks, fmi2False, fmi2False);
        if (!fmu->component)
            fail("%s cannot be instantiated: %s", fmu->model, fmu->logged.message);
    }
}

static void initialize(void)
{
    int i;
    for (i = 0; i < setting_count; i++) {
        char *dot = strchr(settings[i][0], '.');
        char *element = text("%.*s", (int)(dot - settings[i][0]), settings[i][0]);
        set(find_fmu(element), dot + 1, settings[i][1]);
        free(element);
    }
    for (i = 0; i < fmu_count; i++) {
        Fmu *fmu = &fmus[i];
        check(fmu->SetupExperiment(fmu->component, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK, "%s: set-up", fmu->name);
        check(fmu->EnterInitializationMode(fmu->component) == fmi2OK, "%s: initialization begins", fmu->name);
        check(fmu->ExitInitializationMode(fmu->component) == fmi2OK, "%s: initialization ends: %s", fmu->name,
              fmu->logged.message);
    }
}

typedef struct {
    uint64_t *bits;
    size_t count;
} Record;

static uint64_t read_bits(Fmu *fmu, Variable *variable)
{
    fmi2Real real = 0;
    fmi2Integer integer = 0;
    uint64_t bits;
    fmi2Status status = variable->type == 'R'   ? fmu->GetReal(fmu->component, &variable->reference, 1, &real)
                        : variable->type == 'I' ? fmu->GetInteger(fmu->component, &variable->reference, 1, &integer)
                                                : fmu->GetBoolean(fmu->component, &variable->reference, 1, &integer);
    if (status != fmi2OK)
        fail("%s.%s cannot be read: %s", fmu->name, variable->name, fmu->logged.message);
    if (variable->type != 'R')
        return (uint64_t)integer;
    memcpy(&bits, &real, sizeof bits);
    return bits;
}

/* One step of all; results reach other elements in the next one. */
static void step(int index, Record *record)
{
    int i, j;
    for (i = 0; i < fmu_count; i++)
        for (j = 0; j < fmus[i].count; j++)
            if (fmus[i].variables[j].is_output) {
                record->bits = realloc(record->bits, sizeof(uint64_t) * (record->count + 1));
                record->bits[record->count++] = read_bits(&fmus[i], &fmus[i].variables[j]);
            }
    for (i = 0; i < wire_count; i++) {
        End *from = &wires[i][0], *to = &wires[i][1];
        uint64_t bits = read_bits(from->fmu, from->variable);
        fmi2Real real;
        fmi2Integer integer = (fmi2Integer)bits;
        fmi2Status status;
        memcpy(&real, &bits, sizeof real);
        status = to->variable->type == 'R' ? to->fmu->SetReal(to->fmu->component, &to->variable->reference, 1, &real)
                 : to->variable->type == 'I'
                     ? to->fmu->SetInteger(to->fmu->component, &to->variable->reference, 1, &integer)
                     : to->fmu->SetBoolean(to->fmu->component, &to->variable->reference, 1, &integer);
        if (status != fmi2OK)
            fail("%s.%s cannot be set: %s", to->fmu->name, to->variable->name, to->fmu->logged.message);
    }
    for (i = 0; i < fmu_count; i++)
        if (fmus[i].DoStep(fmus[i].component, index * STEP_S, STEP_S, fmi2True) != fmi2OK)
            fail("%s: step %d: %s", fmus[i].name, index, fmus[i].logged.message);
}

static Record steps(int from, int to)
{
    Record record = {NULL, 0};
    for (; from < to; from++)
        step(from, &record);
    return record;
}

static int same(Record a, Record b)
{
    return a.count && a.count == b.count && !memcmp(a.bits, b.bits, sizeof(uint64_t) * a.count);
}

static void write_record(const char *path, Record record)
{
    FILE *file = fopen(path, "wb");
    size_t at = 0;
    int i, j;
    if (!file)
        fail("%s: %s", path, strerror(errno));
    while (at < record.count) {
        /* One line per value, so that a comparison shows the first variable that differs. */
        for (i = 0; i < fmu_count; i++)
            for (j = 0; j < fmus[i].count; j++)
                if (fmus[i].variables[j].is_output)
                    fprintf(file, "%s.%s %016llx\n", fmus[i].name, fmus[i].variables[j].name,
                            (unsigned long long)record.bits[at++]);
    }
    if (fclose(file))
        fail("%s: %s", path, strerror(errno));
}

/* ---- Other operations ---- */

static void try_instances(void)
{
    int i, j;
    for (i = 0; i < fmu_count; i++) {
        Fmu *fmu = &fmus[i];
        char *folder = url(fmu->resources);
        char *places[] = {text("%s/resources", folder), text("%s/resources/", folder),
                          text("file:/%s/resources", folder + strlen("file:///")),
                          text("file:///%s/resources", fmu->resources + (*fmu->resources == '/'))};
        const char *instance = "a/path with blanks.and dots";
        fmi2Component component;
        check(!strcmp(fmu->GetVersion(), "2.0"), "%s: version %s", fmu->model, fmu->GetVersion());
        check(!strcmp(fmu->GetTypesPlatform(), "default"), "%s: types %s", fmu->model, fmu->GetTypesPlatform());

        memset(&fmu->logged, 0, sizeof fmu->logged);
        component = fmu->Instantiate(instance, fmi2CoSimulation, "{00000000-0000-0000-0000-000000000000}", places[0],
                                     &fmu->callbacks, fmi2False, fmi2False);
        check(!component, "%s: a wrong GUID is accepted", fmu->model);
        check(fmu->logged.count == 1 && fmu->logged.status >= fmi2Error && strstr(fmu->logged.message, fmu->guid),
              "%s: the message on a wrong GUID is: %s", fmu->model, fmu->logged.message);

        for (j = 0; j < 4; j++) {
            component =
                fmu->Instantiate(instance, fmi2CoSimulation, fmu->guid, places[j], &fmu->callbacks, fmi2False, fmi2True);
            check(component != NULL, "%s: not instantiated with %s: %s", fmu->model, places[j], fmu->logged.message);
            if (!component)
                continue;
            memset(&fmu->logged, 0, sizeof fmu->logged);
            check(fmu->DoStep(component, 0.0, STEP_S, fmi2True) == fmi2Error, "%s: a step before initialization",
                  fmu->model);
            check(fmu->logged.count == 1 && fmu->logged.status == fmi2Error, "%s: %d messages", fmu->model,
                  fmu->logged.count);
            check(!strcmp(fmu->logged.category, "logStatusError"), "%s: category %s", fmu->model, fmu->logged.category);
            check(!strcmp(fmu->logged.instance, instance), "%s: instance %s", fmu->model, fmu->logged.instance);
            check(strstr(fmu->logged.message, "fmi2DoStep") != NULL, "%s: message %s", fmu->model, fmu->logged.message);
            fmu->FreeInstance(component);
        }
    }
}

/* Steps repeated from a saved state, and from a serialized one, give the same results. */
static void try_states(void)
{
    fmi2FMUstate states[8] = {NULL};
    Record first, again;
    int i, kept = 0, serialized = 0;
    for (i = 0; i < fmu_count; i++) {
        Fmu *fmu = &fmus[i];
        fmi2Status status;
        fmu->logged.count = 0;
        status = fmu->GetFMUstate(fmu->component, &states[i]);
        if (fmu->keeps_states)
            check(status == fmi2OK && states[i], "%s: state: %s", fmu->name, fmu->logged.message);
        else
            check(status == fmi2Error && fmu->logged.count == 1, "%s: states are not offered, yet %d", fmu->name, status);
        kept += fmu->keeps_states && status == fmi2OK;
        serialized += fmu->serializes_states;
    }
    if (kept < fmu_count) {
        printf("states are not offered\n");
        return;
    }
    first = steps(STEPS, STEPS + AGAIN);
    for (i = 0; i < fmu_count; i++)
        check(fmus[i].SetFMUstate(fmus[i].component, states[i]) == fmi2OK, "%s: %s", fmus[i].name, fmus[i].logged.message);
    again = steps(STEPS, STEPS + AGAIN);
    check(same(first, again), "steps from a state that was kept differ");
    for (i = 0; i < fmu_count && serialized == fmu_count; i++) {
        Fmu *fmu = &fmus[i];
        size_t size = 0;
        fmi2Byte *bytes;
        check(fmu->SerializedFMUstateSize(fmu->component, states[i], &size) == fmi2OK && size, "%s: size", fmu->name);
        bytes = malloc(size);
        check(fmu->SerializeFMUstate(fmu->component, states[i], bytes, size) == fmi2OK, "%s: to bytes", fmu->name);
        check(fmu->FreeFMUstate(fmu->component, &states[i]) == fmi2OK && !states[i], "%s: state freed", fmu->name);
        check(fmu->DeSerializeFMUstate(fmu->component, bytes, size, &states[i]) == fmi2OK, "%s: from bytes", fmu->name);
        check(fmu->SetFMUstate(fmu->component, states[i]) == fmi2OK, "%s: %s", fmu->name, fmu->logged.message);
        free(bytes);
    }
    if (serialized == fmu_count)
        check(same(first, steps(STEPS, STEPS + AGAIN)), "steps from a state that was bytes differ");
    for (i = 0; i < fmu_count; i++)
        check(fmus[i].FreeFMUstate(fmus[i].component, &states[i]) == fmi2OK, "%s: state freed", fmus[i].name);
}

/* Importers load and unload FMUs many times. */
static void try_loading(void)
{
    int i, round;
    for (i = 0; i < fmu_count; i++)
        for (round = 0; round < 20; round++) {
            Fmu again = fmus[i];
            void *library = open_library(fmus[i].path);
            fmi2Component component;
            *(void **)&again.Instantiate = symbol(library, "fmi2Instantiate");
            *(void **)&again.FreeInstance = symbol(library, "fmi2FreeInstance");
            component = again.Instantiate("again", fmi2CoSimulation, again.guid, again.resources, &again.callbacks, 0, 0);
            check(component != NULL, "%s: not instantiated when loaded again", again.name);
            again.FreeInstance(component);
            check(close_library(library), "%s: not unloaded again", again.name);
        }
}

int main(int count, char **arguments)
{
    Record record;
    int i;
    if (count < 4)
        fail("usage: host STRUCTURE PLATFORM OUTPUT [ELEMENT.VARIABLE=VALUE ...]");
    read_structure(arguments[1], arguments[2]);
    for (i = 4; i < count; i++) {
        char *equals = strchr(arguments[i], '=');
        if (!equals || !strchr(arguments[i], '.'))
            fail("expected ELEMENT.VARIABLE=VALUE instead of %s", arguments[i]);
        *equals = 0;
        settings[setting_count][0] = arguments[i];
        settings[setting_count++][1] = equals + 1;
    }

    try_instances();
    instantiate();
    initialize();
    record = steps(0, STEPS);
    write_record(arguments[3], record);
    try_states();

    for (i = 0; i < fmu_count; i++) {
        check(fmus[i].Terminate(fmus[i].component) == fmi2OK, "%s: terminate", fmus[i].name);
        check(fmus[i].Reset(fmus[i].component) == fmi2OK, "%s: reset", fmus[i].name);
    }
    initialize();
    record.count = record.count / STEPS * AGAIN;
    check(same(record, steps(0, AGAIN)), "steps after a reset differ from those of a fresh instance");
    for (i = 0; i < fmu_count; i++) {
        fmus[i].FreeInstance(fmus[i].component);
        check(close_library(fmus[i].library), "%s: the library is not unloaded", fmus[i].name);
    }
    try_loading();
    printf("%s: %d passed, %d failed\n", arguments[2], passed, failed);
    return failed != 0;
}

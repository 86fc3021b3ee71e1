/* fmu/glue/describe.c - a program of the build. It prints the description of a model from
 * the tables that fmu_model.h declares.
 *
 *   describe model 2 FILE.c ...   print modelDescription.xml of FMI 2.0, with these
 *                                 source files
 *   describe model 3              print modelDescription.xml of FMI 3.0, which names no
 *                                 source files
 *   describe terminals            print terminalsAndIcons.xml of FMI 3.0
 *   describe build NAME=VALUE,... OPTIONS FILE.c ...
 *                                 print buildDescription.xml of FMI 3.0, with these
 *                                 definitions, compiler options (gcc, clang) and source
 *                                 files
 *   describe variables 2|3        print HTML tables of the variables
 *
 * modelDescription.xml is printed with @GUID@ in place of the GUID. fmu/stage.cmake
 * computes the GUID as a hash of this text, and inserts it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_model.h"
#include "tse/version.h"

/* A unit. */
typedef struct unit {
  const char *name;    /* name in the tables of include/tse */
  const char *fmi;     /* name of the unit in FMI */
  const char *type;    /* name of the FMI type for variables with this unit */
  int has_base;        /* 1: the unit is a product of integer powers of SI base units; 0: it is not */
  int kg, m, s, rad;   /* exponents of the base units, if has_base is 1 */
  const char *display; /* unit in which importers show values; NULL: the unit itself */
  double factor;       /* value in the display unit = factor * value in this unit */
} unit;

#define DEG 57.295779513082323 /* degrees in a radian */
static const unit units[] = {
  /* clang-format off */
  { "1",             "1",             "Ratio",                    1, 0, 0, 0, 0, NULL, 0 },
  { "rad",           "rad",           "Angle",                    1, 0, 0, 0, 1, "deg", DEG },
  { "rad/s",         "rad/s",         "AngularVelocity",          1, 0, 0, -1, 1, "deg/s", DEG },
  { "m",             "m",             "Length",                   1, 0, 1, 0, 0, NULL, 0 },
  { "m/s",           "m/s",           "Velocity",                 1, 0, 1, -1, 0, "km/h", 3.6 },
  { "m/s2",          "m/s2",          "Acceleration",             1, 0, 1, -2, 0, NULL, 0 },
  { "s",             "s",             "Time",                     1, 0, 0, 1, 0, NULL, 0 },
  { "kg",            "kg",            "Mass",                     1, 1, 0, 0, 0, NULL, 0 },
  { "kg m2",         "kg.m2",         "MomentOfInertia",          1, 1, 2, 0, 0, NULL, 0 },
  { "N",             "N",             "Force",                    1, 1, 1, -2, 0, "kN", 1e-3 },
  { "N/rad",         "N/rad",         "CorneringStiffness",       1, 1, 1, -2, -1, "kN/deg", 1e-3 / DEG },
  { "Nm",            "N.m",           "Torque",                   1, 1, 2, -2, 0, NULL, 0 },
  { "m/s2/sqrt(s)",  "m/s2/sqrt(s)",  "AccelerationWalk",         0, 0, 0, 0, 0, NULL, 0 },
  { "rad/s/sqrt(s)", "rad/s/sqrt(s)", "AngularVelocityWalk",      0, 0, 0, 0, 0, NULL, 0 },
  { "1/sqrt(s)",     "1/sqrt(s)",     "RatioWalk",                0, 0, 0, 0, 0, NULL, 0 },
  { "1/sqrt(day)",   "1/sqrt(day)",   "RatioWalkPerDay",          0, 0, 0, 0, 0, NULL, 0 },
  { "kg/m",          "kg/m",          "MassPerLength",            1, 1, -1, 0, 0, NULL, 0 },
  { "Hz",            "Hz",            "Frequency",                1, 0, 0, -1, 0, NULL, 0 },
  { "s2/m",          "s2/m",          "PerAcceleration",          1, 0, -1, 2, 0, NULL, 0 },
  { "s4/m2",         "s4/m2",         "PerAccelerationSquared",   1, 0, -2, 4, 0, NULL, 0 },
  { "rad s2/m",      "rad.s2/m",      "AnglePerAcceleration",     1, 0, -1, 2, 1, "deg.s2/m", DEG },
  { "rad/(N m)",     "rad/(N.m)",     "AnglePerTorque",           1, -1, -2, 2, 1, "deg/(N.m)", DEG },
  { "sigma",         "sigma",         "StandardDeviations",       1, 0, 0, 0, 0, NULL, 0 },
  { "nat",           "nat",           "LogDensity",               1, 0, 0, 0, 0, NULL, 0 },
  /* clang-format on */
};

/* Return the unit of a variable. Exit with an error if the unit is not in `units`. */
static const unit *find_unit(const fmu_variable *v)
{
  for (size_t i = 0; i < sizeof units / sizeof units[0]; i++)
    if (strcmp(units[i].name, v->unit) == 0) return &units[i];
  (void)fprintf(stderr, "describe: %s has the unit '%s', which is not in the table of fmu/glue/describe.c\n",
      v->name, v->unit);
  exit(1);
}

/* Return 1 if the model has a variable with this unit. */
static int is_used(const unit *u, int fmi)
{
  if (fmi == 3 && strcmp(u->name, "s") == 0) return 1; /* FMI 3.0 has the variable fmu_time, in s */
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].kind == 'r' && find_unit(&fmu_variables[i]) == u) return 1;
  return 0;
}

/* Return x as text: the shortest decimal number, of 6 to 17 digits, from which a program
 * reads exactly x again. */
static const char *format_number(double x)
{
  static char text[40];
  for (int digits = 6; digits <= 17; digits++) {
    (void)snprintf(text, sizeof text, "%.*g", digits, x);
    if (strtod(text, NULL) == x) break;
  }
  return text;
}

/* Print a string with the special characters of XML escaped. */
static void print_escaped(const char *text)
{
  for (; *text; text++) switch (*text) {
      case '&': (void)fputs("&amp;", stdout); break;
      case '<': (void)fputs("&lt;", stdout); break;
      case '>': (void)fputs("&gt;", stdout); break;
      case '"': (void)fputs("&quot;", stdout); break;
      default: (void)putchar(*text);
    }
}

static void print_attribute(const char *name, const char *value)
{
  (void)printf(" %s=\"", name);
  print_escaped(value);
  (void)putchar('"');
}

/* ---------------------------------------------------------------------------- modelDescription.xml */

/* Data that print_code() keeps from one call to the next. */
typedef struct enumerations {
  int fmi;          /* version of FMI: 2 or 3 */
  const char *open; /* enumeration type whose XML element is not yet closed; NULL: none */
} enumerations;

static void end_type(enumerations *e)
{
  if (e->open) (void)puts(e->fmi == 2 ? "    </Enumeration></SimpleType>" : "    </EnumerationType>");
  e->open = NULL;
}

/* Print a code of an enumeration type. If `type` differs from the type of the previous
 * code, first close the XML element of the previous type and open the element of
 * `type`. */
static void print_code(void *to, const char *type, int32_t code, const char *name, const char *text)
{
  enumerations *const e = to;
  if (!e->open || strcmp(e->open, type) != 0) {
    end_type(e);
    (void)printf(
        e->fmi == 2 ? "    <SimpleType name=\"%s\"><Enumeration>\n" : "    <EnumerationType name=\"%s\">\n",
        type);
    e->open = type;
  }
  (void)printf("      <Item");
  print_attribute("name", name);
  (void)printf(" value=\"%d\"", (int)code);
  print_attribute("description", text);
  (void)puts("/>");
}

static void print_units(int fmi)
{
  enumerations types = { fmi, NULL };
  (void)puts("  <UnitDefinitions>");
  for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
    const unit *const u = &units[i];
    if (!is_used(u, fmi)) continue;
    (void)printf("    <Unit name=\"%s\"", u->fmi);
    if (!u->has_base) {
      (void)puts("/>");
      continue;
    }
    (void)printf("><BaseUnit");
    if (u->kg) (void)printf(" kg=\"%d\"", u->kg);
    if (u->m) (void)printf(" m=\"%d\"", u->m);
    if (u->s) (void)printf(" s=\"%d\"", u->s);
    if (u->rad) (void)printf(" rad=\"%d\"", u->rad);
    (void)printf("/>");
    if (u->display)
      (void)printf("<DisplayUnit name=\"%s\" factor=\"%s\"/>", u->display, format_number(u->factor));
    (void)puts("</Unit>");
  }
  (void)puts("  </UnitDefinitions>\n  <TypeDefinitions>");
  for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
    const unit *const u = &units[i];
    if (!is_used(u, fmi)) continue;
    (void)printf(fmi == 2 ? "    <SimpleType name=\"%s\"><Real" : "    <Float64Type name=\"%s\"", u->type);
    (void)printf(" quantity=\"%s\" unit=\"%s\"", u->type, u->fmi);
    if (u->display) (void)printf(" displayUnit=\"%s\"", u->display);
    (void)puts(fmi == 2 ? "/></SimpleType>" : "/>");
  }
  model_list_codes(print_code, &types);
  end_type(&types);
  (void)puts("  </TypeDefinitions>");
}

/* Return the name that FMI has for the type of a variable. */
static const char *get_type_name(const fmu_variable *v, int fmi)
{
  switch (v->kind) {
    case 'b': return "Boolean";
    case 'e': return "Enumeration";
    case 'r': return fmi == 2 ? "Real" : "Float64";
    default: return fmi == 2 ? "Integer" : "Int32";
  }
}

/* Print the attributes of a variable that are the same in FMI 2.0 and 3.0. */
static void print_identity(const fmu_variable *v, int32_t reference)
{
  (void)printf(" name=\"%s\" valueReference=\"%d\"", v->name, (int)reference);
  print_attribute("description", v->text);
  print_attribute("causality",
      v->role == 'p' ? "parameter"
                     : (v->role == 'i' ? "input" : (v->role == 'o' ? "output" : "independent")));
  print_attribute("variability", v->role == 'p' ? "fixed" : (v->kind == 'r' ? "continuous" : "discrete"));
  if (v->role == 'p' || v->role == 'o') print_attribute("initial", v->role == 'p' ? "exact" : "calculated");
}

/* Print the attributes of the type of a variable: unit, range, start value. */
static void print_type(const fmu_variable *v)
{
  if (v->kind == 'r') {
    const unit *const u = find_unit(v);
    print_attribute("declaredType", u->type);
    print_attribute("unit", u->fmi);
    if (u->display) print_attribute("displayUnit", u->display);
  }
  if (v->kind == 'e') print_attribute("declaredType", v->unit);
  if (v->hi >= v->lo && v->kind != 'b') {
    print_attribute("min", format_number(v->start < v->lo ? v->start : v->lo));
    print_attribute("max", format_number(v->hi));
  }
  if (v->role == 'p' || v->role == 'i')
    print_attribute("start", v->kind == 'b' ? (v->start > 0.0 ? "true" : "false") : format_number(v->start));
}

static void print_variable2(int32_t index)
{
  const fmu_variable *const v = &fmu_variables[index];
  (void)printf("    <ScalarVariable");
  print_identity(v, index);
  (void)printf(">\n      <%s", get_type_name(v, 2));
  print_type(v);
  (void)puts("/>\n    </ScalarVariable>");
}

/* Print a variable for FMI 3.0.
 *   Given:  v      an element of fmu_variables (name and value reference as in FMI 2.0),
 *                  an array, or fmu_time
 *           count  number of values: 1 for a scalar, more for an array */
static void print_variable3(const fmu_variable *v, int32_t reference, int32_t count)
{
  (void)printf("    <%s", get_type_name(v, 3));
  print_identity(v, reference);
  print_type(v);
  if (count > 1) (void)printf("><Dimension start=\"%d\"/></%s>\n", (int)count, get_type_name(v, 3));
  else (void)puts("/>");
}

/* Return 1 if the model has an input that accepts a time derivative. */
static int has_rates(void)
{
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].rate != FMU_NO_RATE) return 1;
  return 0;
}

static void print_outputs(const char *element, const char *dependencies)
{
  (void)printf("    <%s>\n", element);
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].role == 'o')
      (void)printf("      <Unknown index=\"%d\"%s/>\n", (int)i + 1, dependencies);
  (void)printf("    </%s>\n", element);
}

/* Print the beginning of modelDescription.xml: the XML declaration and the start tag of
 * the root element with its attributes. */
static void print_head(int fmi)
{
  (void)puts("<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
  (void)printf("<fmiModelDescription fmiVersion=\"%d.0\"", fmi);
  print_attribute("modelName", fmu_about.identifier);
  (void)printf(" %s=\"@GUID@\"", fmi == 2 ? "guid" : "instantiationToken");
  print_attribute("description", fmu_about.description);
  print_attribute("author", "the tse authors");
  print_attribute("version", TSE_VERSION);
  print_attribute("copyright", "the tse authors");
  print_attribute("license", "Apache-2.0, see documentation/licenses");
  print_attribute("generationTool", "tse " TSE_VERSION);
  (void)puts(" variableNamingConvention=\"structured\">");
}

/* Print the elements from UnitDefinitions to the start of ModelVariables. */
static void print_middle(int fmi)
{
  print_units(fmi);
  (void)puts("  <LogCategories>");
#define X(name, text) (void)puts("    <Category name=\"" name "\" description=\"" text "\"/>");
  FMU_LOG_CATEGORIES(X)
#undef X
  (void)puts("  </LogCategories>");
  (void)printf("  <DefaultExperiment startTime=\"0\" stopTime=\"%s\"", format_number(fmu_about.stop_time));
  (void)printf(" tolerance=\"%s\"", format_number(fmu_about.tolerance));
  (void)printf(" stepSize=\"%s\"/>\n", format_number(fmu_about.step_size));
  (void)puts("  <ModelVariables>");
}

/* Attribute `dependencies`: inputs on which an output depends at a communication point.
 * The list is empty, because an input that is set at a communication point does not
 * change the outputs at this point. It changes them at the end of the next step. */
#define AT_STEPS " dependencies=\"\""
/* Attribute `dependencies` of an output for initialization mode. It is left out. FMI then
 * assumes that the output depends on all parameters and inputs. In initialization mode
 * this is true: after a parameter or input was set, all outputs are computed again. */
#define AT_START ""

static void print_model2(int files, char **file)
{
  print_head(2);
  (void)printf(
      "  <CoSimulation modelIdentifier=\"%s\" needsExecutionTool=\"false\" "
      "canHandleVariableCommunicationStepSize=\"true\"\n"
      "    canInterpolateInputs=\"%s\" maxOutputDerivativeOrder=\"0\" canRunAsynchronuously=\"false\"\n"
      "    canBeInstantiatedOnlyOncePerProcess=\"false\" canNotUseMemoryManagementFunctions=\"true\"\n"
      "    canGetAndSetFMUstate=\"true\" canSerializeFMUstate=\"true\" "
      "providesDirectionalDerivative=\"false\">\n"
      "    <SourceFiles>\n",
      fmu_about.identifier, has_rates() ? "true" : "false");
  for (int i = 0; i < files; i++) (void)printf("      <File name=\"%s\"/>\n", file[i]);
  (void)puts("    </SourceFiles>\n  </CoSimulation>");
  print_middle(2);
  for (int32_t i = 0; i < fmu_variable_count; i++) print_variable2(i);
  (void)puts("  </ModelVariables>\n  <ModelStructure>");
  print_outputs("Outputs", AT_STEPS);
  print_outputs("InitialUnknowns", AT_START);
  (void)puts("  </ModelStructure>\n</fmiModelDescription>");
}

static void print_unknowns(const char *element, const char *dependencies)
{
  for (int32_t i = 0; i < fmu_variable_count + fmu_array_count; i++)
    if (i >= fmu_variable_count || fmu_variables[i].role == 'o')
      (void)printf("    <%s valueReference=\"%d\"%s/>\n", element, (int)i, dependencies);
}

static void print_model3(void)
{
  print_head(3);
  (void)printf("  <CoSimulation modelIdentifier=\"%s\" needsExecutionTool=\"false\" "
               "canHandleVariableCommunicationStepSize=\"true\"\n"
               "    canBeInstantiatedOnlyOncePerProcess=\"false\" canGetAndSetFMUState=\"true\" "
               "canSerializeFMUState=\"true\"\n"
               "    providesDirectionalDerivatives=\"false\" providesAdjointDerivatives=\"false\" "
               "providesPerElementDependencies=\"false\"\n"
               "    maxOutputDerivativeOrder=\"0\" providesIntermediateUpdate=\"false\" "
               "mightReturnEarlyFromDoStep=\"false\"\n"
               "    canReturnEarlyAfterIntermediateUpdate=\"false\" hasEventMode=\"false\"/>\n",
      fmu_about.identifier);
  print_middle(3);
  for (int32_t i = 0; i < fmu_variable_count; i++) print_variable3(&fmu_variables[i], i, 1);
  for (int32_t k = 0; k < fmu_array_count; k++)
    print_variable3(&fmu_arrays[k].of, fmu_variable_count + k, fmu_arrays[k].count);
  print_variable3(&fmu_time, fmu_variable_count + fmu_array_count, 1);
  (void)puts("  </ModelVariables>\n  <ModelStructure>");
  print_unknowns("Output", AT_STEPS);
  print_unknowns("InitialUnknown", AT_START);
  (void)puts("  </ModelStructure>\n</fmiModelDescription>");
}

/* --------------------------------------------------------------------------- terminalsAndIcons.xml */

static void print_terminals(void)
{
  (void)puts("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiTerminalsAndIcons fmiVersion=\"3.0\">\n  "
             "<GraphicalRepresentation>\n"
             "    <CoordinateSystem x1=\"-100\" y1=\"-100\" x2=\"100\" y2=\"100\" "
             "suggestedScalingFactorTo_mm=\"0.1\"/>\n"
             "    <Icon x1=\"-100\" y1=\"-100\" x2=\"100\" y2=\"100\"/>\n  </GraphicalRepresentation>\n  "
             "<Terminals>");
  for (int32_t k = 0; k < fmu_terminal_count; k++) {
    const fmu_terminal *const t = &fmu_terminals[k];
    const size_t length = strlen(t->prefix);
    (void)printf("    <Terminal");
    print_attribute("name", t->name);
    print_attribute("matchingRule", "bus"); /* importers connect members with the same name */
    print_attribute("terminalKind", t->kind);
    print_attribute("description", t->text);
    (void)puts(">");
    for (int32_t i = 0; i < fmu_variable_count; i++) {
      const fmu_variable *const v = &fmu_variables[i];
      if (v->role != t->role || v->kind != 'r' || strncmp(v->name, t->prefix, length) != 0
          || strchr(v->name + length, '.'))
        continue;
      (void)printf(
          "      <TerminalMemberVariable variableName=\"%s\" memberName=\"%s\" variableKind=\"signal\"/>\n",
          v->name, v->name + length);
    }
    (void)puts("    </Terminal>");
  }
  (void)puts("  </Terminals>\n</fmiTerminalsAndIcons>");
}

/* ---------------------------------------------------------------------------- buildDescription.xml */

static void print_definition(char *definition)
{
  char *const value = strchr(definition, '=');
  if (!value) {
    (void)fprintf(stderr, "describe: '%s' is not NAME=VALUE\n", definition);
    exit(1);
  }
  *value = '\0';
  (void)printf("      <PreprocessorDefinition name=\"%s\" value=\"%s\"/>\n", definition, value + 1);
}

static void print_build(char *definitions, const char *options, int files, char **file)
{
  (void)puts("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiBuildDescription fmiVersion=\"3.0\">");
  (void)printf(
      "  <BuildConfiguration modelIdentifier=\"%s\">\n    <SourceFileSet language=\"C99\" compiler=\"gcc\"",
      fmu_about.identifier);
  print_attribute("compilerOptions", options);
  (void)puts(">");
  for (int i = 0; i < files; i++) (void)printf("      <SourceFile name=\"%s\"/>\n", file[i]);
  for (char *d = strtok(definitions, ","); d; d = strtok(NULL, ",")) print_definition(d);
  (void)puts("    </SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>");
}

/* ------------------------------------------------------------------------------------------- HTML */

static void print_cell(const char *text)
{
  (void)fputs("<td>", stdout);
  print_escaped(text);
  (void)fputs("</td>", stdout);
}

static void print_code_row(void *to, const char *type, int32_t code, const char *name, const char *text)
{
  const char **const last = to;
  if (!*last || strcmp(*last, type) != 0) {
    const char *between = "";
    (void)printf("%s<h3>Codes of <code>", *last ? "</table>\n" : "");
    for (int32_t i = 0; i < fmu_variable_count; i++) {
      if (fmu_variables[i].kind != 'e' || strcmp(fmu_variables[i].unit, type) != 0) continue;
      (void)printf("%s%s", between, fmu_variables[i].name);
      between = ", ";
    }
    (void)puts("</code></h3>\n<table "
               "class=\"codes\"><thead><tr><th>code</th><th>name</th><th>meaning</th></tr></thead>");
    *last = type;
  }
  (void)printf("<tr><td class=\"number\">%d</td><td><code>%s</code></td>", (int)code, name);
  print_cell(text);
  (void)puts("</tr>");
}

/* Return the length of the group in a structured name. The group is the part before the
 * last dot, as "vehicle" in "vehicle.mass". Return 0 if the name has no dot. */
static size_t find_group_length(const char *name)
{
  const char *const dot = strrchr(name, '.');
  return dot ? (size_t)(dot - name) : 0;
}

static int is_same_group(const fmu_variable *a, const fmu_variable *b)
{
  const size_t length = find_group_length(a->name);
  return a->role == b->role && length == find_group_length(b->name) && strncmp(a->name, b->name, length) == 0;
}

static void print_variable_row(const fmu_variable *v, int fmi, int32_t count)
{
  const size_t group = find_group_length(v->name);
  char size[16] = "";
  if (count > 1) (void)snprintf(size, sizeof size, "[%d]", (int)count);
  (void)printf("<tr><td><code>%.*s%s%s</code></td><td>%s%s</td><td>%s</td>", (int)group, v->name,
      group ? ".<wbr>" : "", v->name + group + (group > 0), get_type_name(v, fmi), size,
      v->kind == 'r' ? find_unit(v)->fmi : ""); /* at <wbr>, the browser may break a long name */
  if (v->role != 'o') {
    /* Real: 6 digits, to be readable; modelDescription.xml has all digits. Integer:
     * 10 digits, enough for all values */
    const int digits = v->kind == 'r' ? 6 : 10;
    (void)fputs("<td class=\"number\">", stdout);
    if (v->kind == 'b') (void)fputs(v->start > 0.0 ? "true" : "false", stdout);
    else (void)printf("%.*g", digits, v->start);
    (void)fputs("</td><td class=\"number\">", stdout);
    if (v->kind != 'b' && v->hi >= v->lo) (void)printf("%.*g to %.*g", digits, v->lo, digits, v->hi);
    (void)fputs("</td>", stdout);
  }
  print_cell(v->text);
  (void)puts("</tr>");
}

/* Print three HTML tables of the variables: inputs, outputs, parameters. In a table,
 * variables with the same group (find_group_length()) stand together. The groups are in
 * the order of their first variables. For FMI 3.0, add a table of the arrays and the
 * time. Then, for each enumeration type, print one table of its codes. */
static void print_variables(int fmi)
{
  static const struct {
    char role;
    const char *title, *id;
  } roles[] = { { 'i', "Inputs", "inputs" }, { 'o', "Outputs", "outputs" },
    { 'p', "Parameters", "parameters" } };
  const char *table = NULL;
  for (size_t k = 0; k < sizeof roles / sizeof roles[0]; k++) {
    const int ranges = roles[k].role != 'o';
    (void)printf(
        "<h3 id=\"%s\">%s</h3>\n<table class=\"variables\"><thead><tr>", roles[k].id, roles[k].title);
    (void)printf("<th>name</th><th>type</th><th>unit</th>");
    (void)printf("%s<th>meaning</th></tr></thead>\n", ranges ? "<th>start</th><th>range</th>" : "");
    for (int32_t first = 0; first < fmu_variable_count; first++) {
      const fmu_variable *const head = &fmu_variables[first];
      int32_t before = 0;
      while (before < first && !is_same_group(&fmu_variables[before], head)) before++;
      if (head->role != roles[k].role || before < first) continue;
      (void)puts("<tbody>");
      const int length = (int)find_group_length(head->name);
      if (length > 0)
        (void)printf("<tr class=\"group\"><th colspan=\"%d\"><code>%.*s</code></th></tr>\n", ranges ? 6 : 4,
            length, head->name);
      for (int32_t i = first; i < fmu_variable_count; i++)
        if (is_same_group(&fmu_variables[i], head)) print_variable_row(&fmu_variables[i], fmi, 1);
      (void)puts("</tbody>");
    }
    (void)puts("</table>");
  }
  if (fmi == 3) {
    (void)puts("<h3 id=\"arrays\">Arrays, and the time</h3>\n<table "
               "class=\"variables\"><thead><tr><th>name</th><th>type</th><th>unit</th>"
               "<th>meaning</th></tr></thead>\n<tbody>");
    for (int32_t k = 0; k < fmu_array_count; k++)
      print_variable_row(&fmu_arrays[k].of, fmi, fmu_arrays[k].count);
    (void)printf("<tr><td><code>time</code></td><td>%s</td><td>s</td>", get_type_name(&fmu_time, fmi));
    print_cell(fmu_time.text);
    (void)puts("</tr></tbody></table>");
  }
  model_list_codes(print_code_row, &table);
  if (table) (void)puts("</table>");
}

int main(int count, char **argument)
{
  const char *const what = count > 1 ? argument[1] : "", *const version = count > 2 ? argument[2] : "";
  const int fmi = strcmp(version, "2") == 0 ? 2 : (strcmp(version, "3") == 0 ? 3 : 0);
  if (strcmp(what, "model") == 0 && fmi == 2 && count > 3) print_model2(count - 3, argument + 3);
  else if (strcmp(what, "model") == 0 && fmi == 3 && count == 3) print_model3();
  else if (strcmp(what, "terminals") == 0 && count == 2) print_terminals();
  else if (strcmp(what, "build") == 0 && count > 4)
    print_build(argument[2], argument[3], count - 4, argument + 4);
  else if (strcmp(what, "variables") == 0 && fmi && count == 3) print_variables(fmi);
  else {
    (void)fputs("usage: describe model 2 FILE.c ... | describe model 3 | describe terminals | describe build "
                "NAME=VALUE,... OPTIONS FILE.c ... | "
                "describe variables 2|3\n",
        stderr);
    return 2;
  }
  return fflush(stdout) == 0 && !ferror(stdout) ? 0 : 1;
}

# cmake -DSOURCE=test_x.c -DRUNNER=FILE -P runner.cmake
# Write the program that runs the tests in SOURCE: all functions `static void
# test_...(void)`, in their order and under the same #if. suiteSetUp() runs before the
# tests, if SOURCE has it. If SOURCE has a function again(), the tests are repeated while
# again() returns 1. If SOURCE has its own main(), the program only includes SOURCE.
file(READ "${SOURCE}" text)
set(tests "#include \"${SOURCE}\"\n")
if(NOT text MATCHES "\nint main\\(void\\)")
  string(APPEND tests "\nint main(void)\n{\n  UnityBegin(\"${SOURCE}\");\n")
  if(text MATCHES "\nvoid suiteSetUp\\(void\\)")
    string(APPEND tests "  suiteSetUp();\n")
  endif()
  set(repeat "")
  if(text MATCHES "\nstatic int again\\(void\\)")
    string(APPEND tests "  do {\n")
    set(repeat "  } while (again());\n")
  endif()
  string(REGEX MATCHALL "\n(static void test_[A-Za-z0-9_]+\\(void\\)|#(if|elif|else|endif)[^\n]*)" found "${text}")
  foreach(line IN LISTS found)
    string(REGEX REPLACE "\nstatic void (test_[A-Za-z0-9_]+)\\(void\\)" "  RUN_TEST(\\1);" line "${line}")
    string(APPEND tests "${line}\n")
  endforeach()
  string(APPEND tests "${repeat}  return UnityEnd();\n}\n")
endif()
file(WRITE "${RUNNER}" "${tests}")

#include "program.h"

#include "test_scene.h"

#include <cstdlib>
#include <sys/wait.h>

namespace farol::test {

Outcome farol(const std::string& arguments, const std::string& environment) {
  const TemporaryFolder folder;
  const std::string command =
      environment + " '" FAROL_PROGRAM "' " + arguments + " >" + folder.path("out") + " 2>" + folder.path("err");
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), readText(folder.path("out")),
          readText(folder.path("err"))};
}

}  // namespace farol::test

#include "program.h"

#include "test_scene.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace farol::test {

Outcome farol(const std::string& arguments, const std::string& environment) {
  const TemporaryFolder folder;
  // `exec` puts the program in the shell's place, so that the resources counted are its own.
  const std::string command =
      environment + " exec '" FAROL_PROGRAM "' " + arguments + " >" + folder.path("out") + " 2>" + folder.path("err");
  const pid_t child = fork();
  if (child == 0) {
    execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    _exit(127);
  }
  int status = 0;
  rusage usage{};
  wait4(child, &status, 0, &usage);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), readText(folder.path("out")),
          readText(folder.path("err")), static_cast<size_t>(usage.ru_maxrss) * 1024};
}

}  // namespace farol::test

#include <cstdio>
#include <exception>

#include "service/daemon.hpp"
#include "service/law_file.hpp"

namespace {

constexpr int kFailed = 1;
constexpr int kBadInput = 2;

int refuse(const std::exception& error, int code) {
  std::fprintf(stderr, "eampcd: %s\n", error.what());
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const auto parsed = eampc::service::parse_options(argc, argv);
    if (!parsed.text.empty()) {
      std::fputs(parsed.text.c_str(), stdout);
      return 0;
    }
    return eampc::service::run_daemon(parsed.options);
  } catch (const eampc::service::BadInput& error) {
    return refuse(error, kBadInput);
  } catch (const eampc::service::LawFileError& error) {
    return refuse(error, kBadInput);
  } catch (const std::exception& error) {
    return refuse(error, kFailed);
  }
}

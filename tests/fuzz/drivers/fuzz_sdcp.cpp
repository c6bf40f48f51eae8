// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdlib>
#include <string_view>
#include <telefab/fab/drivers/sdcp_model.hpp>
#include <telefab/fab/drivers/sdcp_printer.hpp>

namespace telefab::fab {
namespace {

/// A printer that answers with the next piece of the input, whatever it is asked. A zero byte ends a piece.
class AnyAnswers final : public PrinterNetwork {
 public:
  explicit AnyAnswers(std::string_view text) : rest_{text} {}
  std::optional<std::string> next() {
    if (rest_.empty()) return std::nullopt;
    const auto end = rest_.find('\0');
    std::string piece{rest_.substr(0, end)};
    rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
    return piece;
  }
  Result<std::vector<Datagram>> ask(std::string_view, std::uint16_t, std::string_view, Nanoseconds) override {
    const auto piece = next();
    return piece ? std::vector<Datagram>{{"10.0.0.7", *piece}} : std::vector<Datagram>{};
  }
  Result<std::unique_ptr<MessageSocket>> connect(const PrinterAddress&, std::string_view, Nanoseconds) override {
    return std::make_unique<Socket>(*this);
  }
  Result<HttpReply> post(const PrinterAddress&, std::string_view, std::string_view, std::string, Nanoseconds) override {
    const auto piece = next();
    if (!piece) return fail(ErrorCode::DeviceLost, "the end of the input");
    return HttpReply{200, *piece};
  }

 private:
  class Socket final : public MessageSocket {
   public:
    explicit Socket(AnyAnswers& owner) : owner_{owner} {}
    Result<void> send(std::string_view, Nanoseconds) override { return {}; }
    Result<std::optional<std::string>> receive(Nanoseconds) override {
      auto piece = owner_.next();
      if (!piece) return fail(ErrorCode::DeviceLost, "the end of the input");
      return piece;
    }

   private:
    AnyAnswers& owner_;
  };
  std::string_view rest_;
};

template <class Answer>
void check(const Answer& answer) {
  if (!answer && (answer.error().code == ErrorCode::Internal || answer.error().what.empty())) std::abort();
}

}  // namespace
}  // namespace telefab::fab

// Any bytes as what a printer answers, and as what a client asks of the simulated one.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  using namespace telefab::fab;
  const std::string_view text{reinterpret_cast<const char*>(data), size};
  VirtualClock clock;
  {
    AnyAnswers network{text};
    SdcpOptions options;
    options.address.host = "10.0.0.7";
    if (size > 0 && (data[0] & 1U) != 0) options.id = "a";
    const auto printer = make_sdcp_printer(network, clock, options);
    const std::vector<std::byte> bytes(10);
    const PrinterUpload file{"a.goo", bytes.size(), "0",
                             [&](std::uint64_t, std::size_t) -> Result<std::vector<std::byte>> { return bytes; }};
    check(printer->facts());
    check(printer->status());
    check(printer->begin_upload(file));
    for (int i = 0; i < 3; ++i) check(printer->send_part());
    check(printer->start("a.goo"));
    check(printer->task("t"));
    check(printer->status());
  }
  SdcpModel model{{}, clock};
  (void)model.on_datagram(text);
  (void)model.on_message(text);
  (void)model.on_post("/uploadFile/upload", "multipart/form-data; boundary=b", text);
  (void)model.pushed();
  return 0;
}

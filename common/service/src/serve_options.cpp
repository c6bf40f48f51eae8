// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/service/serve_options.hpp>

namespace telefab {

Option add_address(VerbOptions& options, const std::string& name, std::string& into, const std::string& help) {
  return options.add(name, into, help).read_by(net::endpoint_from_text);
}

Option add_address_or_none(VerbOptions& options, const std::string& name, std::string& into, const std::string& help) {
  return options.add(name, into, help).read_by([](const std::string& text) -> Result<net::Endpoint> {
    return text.empty() ? net::Endpoint{} : net::endpoint_from_text(text);
  });
}

void declare_serve_options(VerbOptions& app, ServeOptions& options) {
  add_address(app, "--listen", options.listen, "HOST:PORT; port 0 takes a free one; off loopback --tls is needed")
      .shows_default();
  app.add("--data", options.data, "folder for jobs, made where there is none; one daemon a folder").required();
  declare_machine_folder(app, options.machines);
  app.add("--tls", options.tls_folder,
          "folder with authority.crt, NAME.crt, NAME.key and revoked.crl, as `telefab certs` makes it");
  app.add("--tls-name", options.tls_name, "NAME of the certificate in that folder").shows_default();
  add_address(
      app, "--web", options.web,
      "HOST:PORT of the web page and its API, e.g. 127.0.0.1:7480; default: none. Off loopback it is served over TLS "
      "with the certificate of --tls. Where operators have tokens (the verb tokens), where it is off loopback and "
      "with --web-host everybody signs in: with a token or an operator's certificate. Elsewhere whoever is on this "
      "machine sees it, and what changes a job needs a link of the verb page-link, or the token in DATA/web-token");
  app.add("--web-host", options.web_hosts,
          "a name under which the page may be asked for besides those of loopback: its own off loopback, or that of a "
          "TLS proxy before it; may be given again");
  app.add("--hook", options.hooks.program,
          "program to run at every change of a job's state: TELEFAB_JOB, TELEFAB_STATE, TELEFAB_MESSAGE, "
          "TELEFAB_NAME, TELEFAB_MACHINE and TELEFAB_INSTANCE in its environment, the job as JSON on its input");
  app.add("--webhook", options.hooks.url, "http:// or https:// address that gets the same JSON as a POST");
  app.add("--log-level", options.log_level, "how much is logged; debug adds a line a layer")
      .one_of({"debug", "info", "warning"})
      .shows_default();
  app.add("--reserve-mib", options.reserve_mib,
          "MiB of the data folder's disk that are kept for the job list and the logs; a job that does not fit beside "
          "them waits until there is room")
      .shows_default();
  app.add("--keep-days", options.retention.keep_days,
          "days after which a job that has ended is forgotten with its files; 0: never. As-built records and the audit "
          "log stay")
      .shows_default();
  app.add("--keep-gib", options.retention.keep_gib,
          "GiB that jobs that have ended may take before the oldest are forgotten; 0: without limit")
      .shows_default();
}

Result<std::shared_ptr<net::Trust>> trust_of(const ServeOptions& options) {
  if (options.tls_folder.empty()) return std::shared_ptr<net::Trust>{};
  return net::Trust::load(net::tls_files_in(options.tls_folder, options.tls_name));
}

Result<std::unique_ptr<net::Listener>> open_listener(
    net::Loop& loop, const ServeOptions& options, std::shared_ptr<net::Trust> trust,
    std::function<void(const net::ConnectionPtr&)> on_connection,
    std::function<void(std::string_view who, std::string_view what)> note) {
  const auto listen = net::endpoint_from_text(options.listen);
  if (!listen) return fail_in("--listen", listen.error());
  return net::Listener::open(
      loop, {*listen, std::move(trust), {}},
      {std::move(on_connection), [note = std::move(note)](const std::string& address, const Error& why) {
         note(address, "refused: " + why.what);
       }});
}

}  // namespace telefab
